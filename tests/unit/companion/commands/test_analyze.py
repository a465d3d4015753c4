"""`companion analyze` through its real entry point: synthetic runs of known truth, bad input, real recordings."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from companion.analysis.result import RunResult
from tests.analyze_command import TX_PLACE, Cli, links, one_line
from tests.csi_records import needs_data
from tests.paths import DATA, FIELD_CASES, ROOT
from tests.synthetic_run import RX_MAC, STAMP, TX_MAC, RunFolder, write_run
from tests.unit.companion.commands.spoiled_run import spoil


@pytest.mark.parametrize(
    ("place", "layout"), [(TX_PLACE, 34), (TX_PLACE, 38), ((-9.0, 3.0, 8.0), 38), ((2.0, -12.0, -1.5), 34)]
)
def test_bearing_of_a_known_transmitter(
    cli: Cli, tmp_path: Path, place: tuple[float, float, float], layout: int
) -> None:
    folder = write_run(tmp_path / "set" / "p", place, layout).folder
    outcome = cli(folder, "--no-pictures", "--json", "r.json")
    assert outcome.code == 0, outcome.err
    link = links(tmp_path / "r.json")["tx2"]
    true_azimuth = np.degrees(np.arctan2(place[1] + 2.0, place[0] - 1.0))
    assert link["true_azimuth_deg"] == pytest.approx(true_azimuth, abs=0.5)
    # The wavefront is curved at this distance, which a plane-wave model feels.
    assert link["great_circle_error_deg"] < 1.0
    assert (link["packets"], link["used"], link["dropped"]) == (500, 500, {})
    # The elevation is above the horizon, the polar angle from Up.
    assert np.sign(link["true_elevation_deg"]) == np.sign(place[2] - 0.5)
    for which in ("", "true_"):
        assert link[f"{which}elevation_deg"] == pytest.approx(90 - link[f"{which}polar_deg"])


def test_flat_path_shows_no_elevation(cli: Cli, tmp_path: Path) -> None:
    folder = write_run(tmp_path / "set" / "p", (6.0, -3.0, 0.3), flat=True).folder
    outcome = cli(folder, "--no-pictures", "--json", "r.json")
    link = links(tmp_path / "r.json")["tx2"]
    assert link["polar_deg"] is None and link["elevation_deg"] is None and link["great_circle_error_deg"] is None
    assert abs(link["azimuth_error_deg"]) < 1.0
    row = next(line for line in outcome.out.splitlines() if "tx2" in line)
    assert row.split("│")[3].strip() == "-"


def test_pictures_and_table(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    outcome = cli(run.folder.parent.parent, "--out", "pictures")
    assert outcome.code == 0
    pictures = list((tmp_path / "pictures").iterdir())
    assert [p.name for p in pictures] == [f"set_{STAMP}_tx2_mocap.png"]
    assert pictures[0].read_bytes()[:4] == b"\x89PNG" and pictures[0].stat().st_size > 20_000
    for text in ("500/500", "none", "reliability", STAMP):
        assert text in outcome.out


def test_loose_files(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    moved = {name: tmp_path / f"{name}.bin" for name in ("rx", "tx", "trajectory")}
    for name, path in moved.items():
        shutil.copy(getattr(run, name), path)
    arguments = ["--rx", moved["rx"], "--tx", moved["tx"], "--traj", moved["trajectory"], "--no-pictures"]
    outcome = cli(*arguments)
    assert outcome.code == 1 and "give --channel" in outcome.err
    # The only sender is found without --mac; where it stands is not known here.
    for extra in ([], ["--mac", TX_MAC.lower()], ["--mac", f"tx={TX_MAC}"]):
        outcome = cli(*arguments, "--channel", "108", "--json", "r.json", *extra)
        assert outcome.code == 0, outcome.err
        link = links(tmp_path / "r.json")["tx"]
        assert link["mac"] == TX_MAC and link["true_azimuth_deg"] is None
        assert link["azimuth_deg"] == pytest.approx(76.0, abs=1.0)


def test_run_option_chooses(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    for path in list(run.folder.glob(f"*{STAMP}*")):
        shutil.copy(path, path.with_name(path.name.replace(STAMP, "2026-01-02_999999")))
    assert cli(run.folder, "--no-pictures").out.count("tx2") == 2
    assert cli(run.folder, "--run", STAMP, "--no-pictures").out.count("tx2") == 1
    outcome = cli(run.folder, "--run", "2020", "--no-pictures")
    assert outcome.code == 1
    assert one_line(outcome) and STAMP in outcome.err


def test_dropped_packets_are_counted_by_reason(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    records = run.tx.read_bytes()
    size = len(records) // 500
    # Ten pings unheard by the transmitter, one heard twice; the first quarter before the trajectory begins.
    run.tx.write_bytes(records[10 * size :] + records[-size:])
    rows = run.trajectory.read_text().splitlines(keepends=True)
    run.trajectory.write_text("".join(rows[100:]))
    assert cli(run.folder, "--no-pictures", "--json", "r.json").code == 0
    link = links(tmp_path / "r.json")["tx2"]
    assert link["dropped"]["unpaired"] == 10
    assert link["dropped"]["duplicate counter"] == 1
    assert link["dropped"]["outside trajectory"] == pytest.approx(108, abs=3)
    assert link["used"] + sum(link["dropped"].values()) == link["packets"] == 500


@pytest.mark.parametrize(
    ("what", "names", "reason"),
    [
        ("no rx", "csi_rx_", "missing"),
        ("no tx", "csi_tx", "csi_tx<n>"),
        ("no trajectory", "rx_trajectory_", "no trajectory"),
        ("empty rx", "csi_rx_", "empty file"),
        ("empty tx", "csi_tx2_", "empty file"),
        ("empty trajectory", "rx_trajectory_", "empty file"),
        ("rx is text", "csi_rx_", "not a CSI log"),
        ("tx is text", "csi_tx2_", "not a CSI log"),
        ("trajectory is binary", "rx_trajectory_", "not a text file"),
        ("trajectory has a word", "rx_trajectory_", "line 2"),
        ("trajectory is narrow", "rx_trajectory_", "line 1 has 3 columns"),
        ("trajectory is NaN", "rx_trajectory_", "no finite poses"),
        ("trajectory stands still", "rx_trajectory_", "never changes"),
        ("trajectory too early", "rx_trajectory_", "no time overlap"),
        ("short trajectory", "tx2", "packets; needs at least"),
        ("one log twice", "csi_tx2_", "is it another robot's log"),
        ("logs swapped", "csi_tx2_", "the ends look swapped"),
        ("no truth", "position", "give --channel"),
        ("trajectory far out", "rx_trajectory_", "1e+155 m away"),
        ("other run", f"csi_rx_{STAMP}.dat and csi_tx2_{STAMP}.dat", "are not of the same run"),
        ("counters all twice", "csi_rx_", "holds more than one run, or one twice"),
    ],
)
def test_bad_files_each_give_one_clear_line(cli: Cli, run: RunFolder, what: str, names: str, reason: str) -> None:
    spoil(run, what)
    outcome = cli(run.folder, "--no-pictures")
    assert outcome.code == 1
    assert one_line(outcome), outcome
    assert outcome.err.startswith("companion: ")
    assert names in outcome.err and reason in outcome.err


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ("truth is no JSON", "not a JSON file"),
        ("truth without channel", "'channel' is missing"),
        ("truth with channel Infinity", "channel.value is inf"),
        ("truth with a place NaN", "position of tx2"),
    ],
)
def test_bad_truth_is_reported_and_not_needed(cli: Cli, run: RunFolder, what: str, reason: str) -> None:
    spoil(run, what)
    outcome = cli(run.folder, "--no-pictures", "--channel", "108")
    assert outcome.code == 0
    assert f"! {run.truth}" in outcome.out and reason in outcome.out


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        ([], 2, "give a RUN folder"),
        (["nowhere"], 1, "nowhere: No such file or directory"),
        (["{rx}"], 1, "Not a directory"),
        (["{empty}"], 1, "no recorded run here"),
        (["--rx", "{rx}"], 2, "need all of --rx, --tx and --traj"),
        (["{run}", "--rx", "{rx}"], 2, "do not go together"),
        (["--rx", "gone.dat", "--tx", "{tx}", "--traj", "{traj}"], 1, "gone.dat: No such file"),
        (["{run}", "--channel", "6"], 2, "channel 6 is a 2.4 GHz channel"),
        (["--rx", "{rx}", "--tx", "gone.dat", "--traj", "{traj}"], 1, "gone.dat: No such file"),
        (["--rx", "{rx}", "--tx", "{tx}", "--traj", "gone.csv"], 1, "gone.csv: No such file"),
        (["--rx", "{rx}", "--tx", "{tx}", "--tx", "{tx}", "--traj", "{traj}"], 1, "two files of one transmitter"),
        (["{run}", "--mac", "00:11:22:33:44:55"], 1, "no packets of 00:11:22:33:44:55; senders heard: " + TX_MAC),
        (["{run}", "--mac", f"tx2={RX_MAC}"], 1, f"no packets of {RX_MAC}"),
        (["{run}", "--mac", "tx9=00:11:22:33:44:55"], 1, "no packets of 00:11:22:33:44:55"),
        (["{run}", "--mac", "00:11:22"], 2, "expected six bytes"),
        (["{run}", "--poses", "odom"], 1, "no odom trajectory"),
        (["{run}", "--poses", "gps"], 2, "'gps' is not one of"),
        (["{run}", "--channel", "300"], 2, "channel 300 is no 5 GHz channel"),
        (["{run}", "--lever", "0.1", "0", "0"], 1, "has no attitude"),
        (["{run}", "--json", "no/such/folder/r.json"], 1, "cannot be written"),
        (["{run}", "--json", "{empty}"], 1, "cannot be written"),
        (["{run}", "--mac", "tx2=00:21:6A:30:D2:3C"], 2, "is the card of tx3, not of tx2"),
        (["{run}", "--mac", f"tx2={TX_MAC}", "--mac", TX_MAC], 2, f"tx2 has already been given {TX_MAC}"),
        (["{run}", "--mac", "00:21:6A:30:D2:3C"], 1, "no packets of 00:21:6A:30:D2:3C"),
        (["{run}", "--lever", "nan", "0", "0"], 2, "expected three finite lengths"),
        (["{run}", "--lever", "0", "0", "-inf"], 2, "expected three finite lengths"),
        (["{run}", "--nonsense"], 2, "No such option"),
    ],
)
def test_bad_arguments(cli: Cli, run: RunFolder, tmp_path: Path, arguments: list[str], code: int, reason: str) -> None:
    (tmp_path / "empty").mkdir()
    places = {"rx": run.rx, "tx": run.tx, "traj": run.trajectory, "run": run.folder, "empty": tmp_path / "empty"}
    outcome = cli("--no-pictures", *(argument.format(**places) for argument in arguments))
    assert outcome.code == code
    assert reason in outcome.err and "Traceback" not in outcome.err
    if code == 1:
        assert len(outcome.err.strip().splitlines()) == 1


def test_places_that_cannot_be_written_are_found_before_the_work(
    cli: Cli, run: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def analyze_nothing(*_: object) -> RunResult:
        raise AssertionError("analysed first")

    monkeypatch.setattr("companion.commands.analyze.analyze_run", analyze_nothing)
    (tmp_path / "file").touch()
    for arguments in (["--no-pictures", "--json", "file/r.json"], ["--out", "file/pictures"]):
        outcome = cli(run.folder, *arguments)
        assert outcome.code == 1 and one_line(outcome) and "cannot be written" in outcome.err


def test_a_channel_that_the_truth_contradicts_is_said(cli: Cli, run: RunFolder) -> None:
    assert "says channel 108, but 100 was given" in cli(run.folder, "--no-pictures", "--channel", "100").out
    assert "says channel" not in cli(run.folder, "--no-pictures", "--channel", "108").out


def test_a_truth_in_millimetres_is_none(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    truth = json.loads(run.truth.read_text())
    place = truth["true_tx_positions"]["value"]["tx2"]["position"]
    place.update({axis: 1000 * value for axis, value in place.items()})
    run.truth.write_text(json.dumps(truth))
    assert cli(run.folder, "--no-pictures", "--json", "r.json").code == 0
    assert "expected metres, and below 1000" in links(tmp_path / "r.json")["tx2"]["truth_problem"]


def test_damage_is_reported_and_the_rest_is_used(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    for path, at in ((run.rx, 100), (run.tx, 200)):
        content = bytearray(path.read_bytes())
        content[at * 233] ^= 0x40
        path.write_bytes(b"\0" + content)
    run.trajectory.write_text(run.trajectory.read_text()[:-9])
    outcome = cli(run.folder, "--no-pictures", "--json", "r.json")
    assert outcome.code == 0
    assert links(tmp_path / "r.json")["tx2"]["used"] == 498
    for path in (run.rx, run.tx):
        assert f"{path}: 2 malformed records, 234 bytes skipped" in outcome.out
    assert f"! {run.trajectory}: its last line, 400, is cut off" in outcome.out


def test_a_straight_path_is_said_to_tell_no_azimuth(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    straight = Path(shutil.copytree(run.folder, run.folder.with_name("straight")))
    rows = [f"{1_700_000_000 + n / 100:.6f},0,{1 + n / 500:.6f},-2,0.3\n" for n in range(400)]
    (straight / run.trajectory.name).write_text("".join(rows))
    outcome = cli(run.folder.parent, "--no-pictures", "--json", "r.json")
    assert "! tx2: azimuth not observable: the path is straight, 0.76 m long and 0.00 m wide" in outcome.out
    assert "elevation above the horizon" in outcome.out and "│ 1 of 2 │" in outcome.out
    sets = json.loads((tmp_path / "r.json").read_text())["sets"]
    assert [(row["links"], row["of_links"]) for row in sets] == [(1, 2)]
    shutil.rmtree(run.folder)
    cli(run.folder.parent, "--no-pictures", "--json", "r.json")
    assert json.loads((tmp_path / "r.json").read_text())["sets"] == [
        {"set": "set", "links": 0, "of_links": 1, "median_deg": None, "mean_deg": None, "share_below_10_deg": None}
    ]


def test_the_installed_program_exits_as_promised(run: RunFolder, tmp_path: Path) -> None:
    """Codes above 0 are told by what this process's own calls raise; `test_cli.py` sees one of a process."""
    command = [sys.executable, "-m", "companion", "analyze", str(run.folder), "--no-pictures"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env={**os.environ}, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


def test_one_bad_link_does_not_stop_the_others(cli: Cli, run: RunFolder) -> None:
    shutil.copy(run.tx, run.tx.with_name(f"csi_tx7_{STAMP}.dat"))
    (run.folder / f"csi_tx3_{STAMP}.dat").write_bytes(b"")
    outcome = cli(run.folder, "--no-pictures")
    assert outcome.code == 0
    assert "tx3: " in outcome.out and "empty file" in outcome.out


@pytest.mark.long
@needs_data
def test_every_recorded_run_with_motion_capture(cli: Cli, tmp_path: Path) -> None:
    outcome = cli(DATA / "wsr_dataset_dev", DATA / "wsr_3d", "--no-pictures", "--json", "r.json")
    assert outcome.code == 0 and outcome.err == ""
    content = json.loads((tmp_path / "r.json").read_text())
    found = [link for run in content["runs"] for link in run["links"]]
    assert (len(content["runs"]), len(found)) == (33, 84)
    assert [link["problem"] for link in found if link["problem"]] == []
    low = [link["reliability"] < 0.1 for link in found]
    assert [any("reliability" in note for note in link["notes"]) for link in found] == low and any(low)
    assert sum("csi_tx2" in line for run in content["runs"] for line in run["problems"]) == 6
    sets = {row["set"]: row for row in content["sets"]}
    print({name: round(row["median_deg"], 2) for name, row in sets.items()})
    assert sets["LOS_Set_A"]["links"] == 18
    assert sets["LOS_Set_A"]["median_deg"] < 4.0


@pytest.mark.parametrize(
    ("poses", "limit_deg"),
    [("mocap", 4.0), *(pytest.param(name, 6.2, marks=pytest.mark.long) for name in ("t265", "odom"))],
)
@needs_data
def test_each_pose_source_on_line_of_sight(cli: Cli, tmp_path: Path, poses: str, limit_deg: float) -> None:
    assert cli(DATA / "wsr_dataset_dev/LOS_Set_A", "--poses", poses, "--no-pictures", "--json", "r.json").code == 0
    sets = json.loads((tmp_path / "r.json").read_text())["sets"]
    assert sets[0]["links"] == 18 and sets[0]["median_deg"] < limit_deg


@needs_data
def test_lost_tracking_is_reported(cli: Cli) -> None:
    outcome = cli(DATA / "wsr_3d", "--run", "2021-03-03_212019", "--poses", "t265", "--no-pictures")
    assert outcome.code == 0
    assert "the tracker drifted or failed" in outcome.out


def test_a_straight_path_gives_its_cone_and_other_directions_on_it(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    rows = [f"{1_700_000_000 + n / 100:.6f},0,{1 + n / 500:.6f},-2,0.3\n" for n in range(400)]
    run.trajectory.write_text("".join(rows))
    outcome = cli(run.folder, "--no-pictures", "--json", "r.json")
    assert "off its direction, on any side" in outcome.out
    link = links(tmp_path / "r.json")["tx2"]
    assert len(link["alternatives"]) >= 2
    assert len(link["paths"]) >= 1
    np.testing.assert_allclose(link["cone"]["axis"], [1, 0, 0], atol=1e-6)
    assert link["cone"]["angle_std_deg"] > 0


_CASES = pytest.mark.skipif(not FIELD_CASES.is_dir(), reason="no field cases beside this clone")
_RIGHT_DEG = (75.9, 76.4)


def _bearing(cli: Cli, folder: Path, result: Path) -> tuple[float, float]:
    ended = cli(folder, "--no-pictures", "--json", result)
    assert ended.code == 0, ended.err
    (link,) = links(result).values()
    return link["azimuth_deg"], link["polar_deg"]


@_CASES
@pytest.mark.parametrize("case", ["traj-8-columns-bagpy", "tum-blanks"])
def test_a_trajectory_of_another_tool_gives_the_right_bearing(cli: Cli, tmp_path: Path, case: str) -> None:
    assert _bearing(cli, FIELD_CASES / case / "run", tmp_path / "r.json") == pytest.approx(_RIGHT_DEG, abs=0.2)


@_CASES
def test_a_truth_with_a_byte_order_mark_is_read(cli: Cli, tmp_path: Path) -> None:
    truth = FIELD_CASES / "truth-bom" / "groundtruth_positions.json"
    assert truth.read_bytes()[:3] == b"\xef\xbb\xbf"
    shutil.copytree(FIELD_CASES / "tum-blanks" / "run", tmp_path / "run")
    shutil.copy(truth, tmp_path / "run")
    assert _bearing(cli, tmp_path / "run", tmp_path / "r.json") == pytest.approx(_RIGHT_DEG, abs=0.2)


@_CASES
def test_a_motive_export_is_called_one_and_what_it_needs_is_said(cli: Cli) -> None:
    ended = cli(FIELD_CASES / "motive-csv-export" / "run", "--no-pictures")
    assert ended.code == 1 and one_line(ended)
    assert "read as an OptiTrack Motive export" in ended.err and "--time-offset puts them there" in ended.err


@_CASES
def test_every_case_is_named_in_a_test() -> None:
    texts = [path.read_text() for path in (ROOT / "tests").rglob("test_*.py")]
    patterns = ("mcap-", "yaml-")
    for folder in FIELD_CASES.iterdir():
        assert folder.name.startswith(patterns) or any(folder.name in text for text in texts), folder.name
