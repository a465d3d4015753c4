"""`companion analyze` on files, truths and arguments that are wrong, each by one line that names it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.analysis.result import RunResult
from tests.analyze_command import Cli, one_line
from tests.synthetic_run import RX_MAC, STAMP, TX_MAC, RunFolder


def _change(run: RunFolder, what: str) -> None:
    match what:
        case "no rx":
            run.rx.unlink()
        case "no tx":
            run.tx.unlink()
        case "no trajectory":
            run.trajectory.unlink()
        case "no truth":
            run.truth.unlink()
        case "empty rx":
            run.rx.write_bytes(b"")
        case "empty tx":
            run.tx.write_bytes(b"")
        case "empty trajectory":
            run.trajectory.write_text("")
        case "rx is text":
            run.rx.write_text("sec,nsec,x,y,z\n" * 300)
        case "tx is text":
            run.tx.write_text("sec,nsec,x,y,z\n" * 300)
        case "trajectory is binary":
            run.trajectory.write_bytes(run.rx.read_bytes())
        case "trajectory has a word":
            run.trajectory.write_text(run.trajectory.read_text().replace("\n", "\nlost,", 1))
        case "trajectory is narrow":
            run.trajectory.write_text("1.0,2.0,3.0\n" * 5)
        case "trajectory is NaN":
            run.trajectory.write_text("1700000000.0,0.0,nan,nan,nan\n" * 500)
        case "trajectory stands still":
            run.trajectory.write_text("".join(f"{1_700_000_000 + n / 100:.6f},0,1,1,1\n" for n in range(500)))
        case "trajectory too early":
            run.trajectory.write_text(run.trajectory.read_text().replace("17000000", "16999990"))
        case "short trajectory":
            run.trajectory.write_text("".join(run.trajectory.read_text().splitlines(keepends=True)[200:208]))
        case "logs swapped":
            run.tx.write_bytes(run.rx.read_bytes())
        case "truth is no JSON":
            run.truth.write_text("{")
        case "truth without channel":
            run.truth.write_text("{}")
        case "truth with channel Infinity":
            run.truth.write_text(run.truth.read_text().replace("108", "Infinity"))
        case "truth with a place NaN":
            run.truth.write_text(run.truth.read_text().replace("2.5", "NaN"))
        case "trajectory far out":
            run.trajectory.write_text(run.trajectory.read_text().replace(",-2.000000", ",1e155"))
        case "other run":
            _replace_stamps(run.tx)
        case "counters all twice":
            run.rx.write_bytes(run.rx.read_bytes()[:-40] * 2)
        case _:
            raise AssertionError(what)


def _replace_stamps(path: Path) -> None:
    """The same counters at another pace: 1 % slower on both clocks."""
    records = np.frombuffer(path.read_bytes(), np.uint8).reshape(500, -1).copy()
    late_us = np.arange(500) * 75
    for at, stamps_us in ((3, (4_290_000_000 + np.arange(500) * 7600 + late_us) % 2**32), (27, late_us + 7600)):
        records[:, at : at + 4] = stamps_us.astype("<u4")[:, None].view(np.uint8)
    seconds, microseconds = np.divmod(np.arange(500) * 7600 + late_us, 1_000_000)
    for at, part in ((23, seconds + 1_700_000_500), (27, microseconds)):
        records[:, at : at + 4] = part.astype("<u4")[:, None].view(np.uint8)
    path.write_bytes(records.tobytes())


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
        ("logs swapped", "csi_tx2_", "no packets of the receiving robot"),
        ("no truth", "position", "give --channel"),
        ("trajectory far out", "rx_trajectory_", "1e+155 m away"),
        ("other run", f"csi_rx_{STAMP}.dat and csi_tx2_{STAMP}.dat", "are not of the same run"),
        ("counters all twice", "csi_rx_", "every frame counter is there twice"),
    ],
)
def test_bad_files_each_give_one_clear_line(cli: Cli, run: RunFolder, what: str, names: str, reason: str) -> None:
    _change(run, what)
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
    _change(run, what)
    outcome = cli(run.folder, "--no-pictures", "--channel", "108")
    assert outcome.code == 0
    assert f"! {run.truth}" in outcome.out and reason in outcome.out


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        ([], 2, "give a RUN folder"),
        (["nowhere"], 1, "nowhere: No such file or directory"),
        (["{rx}"], 1, "not a directory"),
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
