"""Recordings in which the transmitter moves too, clocks that differ, antennas beside the tracked point."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from companion.analysis.bearings import analyze_run
from companion.analysis.imported import analyze_session, export, export_run, import_run
from companion.analysis.result import Options
from companion.analysis.runs import find_runs
from companion.analysis.summary import as_json
from companion.log.reader import open_session
from tests.analyze_command import TX_PLACE, Cli, links, one_line
from tests.csi_bytes import later
from tests.synthetic_run import STAMP, START_S, RunFolder, path_m, write_run
from wsr.geometry import quaternion_from_yaw, rotate

Array = npt.NDArray[np.float64]
RIGHT_DEG = 75.9
"""From the middle of the receiver's way to the middle of the transmitter's."""
CLOCK_S = 38.2
LEVER_M = (0.2, -0.1, 0.15)


def moves_m(t_s: Array) -> Array:
    """A drive to and fro of 0.3 m, about its middle."""
    along = 0.15 * np.cos(2 * np.pi * t_s / 4.0)
    return np.stack([along, 0.5 * along, np.zeros_like(along)], axis=1)


def yaw_rad(t_s: Array) -> Array:
    return 0.4 * t_s


@pytest.fixture(scope="module")
def moving(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    """A run whose transmitter moves and whose host's clock is 38.2 s ahead; its trajectory, by TUM, is that of a point
    beside the antenna, on the clock of the receiver's host."""
    files = write_run(tmp_path_factory.mktemp("moving") / "set" / "p", TX_PLACE, tx_moves_m=moves_m, tx_clock_s=CLOCK_S)
    t_s = np.arange(0.0, 4.0, 0.01)
    q = np.array([quaternion_from_yaw(float(yaw)) for yaw in yaw_rad(t_s)])
    p_m = moves_m(t_s) + np.full(3, 7.0) - rotate(q, np.array(LEVER_M))  # its origin is its own
    rows = zip(t_s + START_S, p_m, q[:, [1, 2, 3, 0]], strict=True)
    lines = [" ".join(f"{value:.6f}" for value in (t, *p, *turn)) for t, p, turn in rows]
    (files.folder / "beacon.tum").write_text("\n".join(lines) + "\n")
    return files


def given(moving: RunFolder) -> list[str]:
    lever = ",".join(map(str, LEVER_M))
    return ["--tx-traj", f"tx2={moving.folder / 'beacon.tum'}", "--tx-time-offset", f"tx2={CLOCK_S}",
            "--tx-lever", f"tx2={lever}"]  # fmt: skip


def test_both_ends_moving_give_the_right_bearing_and_only_with_both_trajectories(
    cli: Cli, moving: RunFolder, tmp_path: Path
) -> None:
    outcome = cli(moving.folder, "--no-pictures", "--json", "r.json", *given(moving))
    assert outcome.code == 0, outcome.err
    assert f"trajectory of tx2: {moving.folder / 'beacon.tum'}" in outcome.out
    with_both = links(tmp_path / "r.json")["tx2"]
    assert with_both["azimuth_deg"] == pytest.approx(RIGHT_DEG, abs=1.5)
    assert with_both["used"] == 500 and with_both["trajectory"].endswith("beacon.tum")
    assert with_both["true_azimuth_deg"] is None and "which moves" in with_both["truth_problem"]
    cli(moving.folder, "--no-pictures", "--json", "r.json")
    without = links(tmp_path / "r.json")["tx2"]
    assert abs(without["azimuth_deg"] - RIGHT_DEG) > 5 or not without["reliability"] > with_both["reliability"] / 2
    # A lever arm left out is a wrong way, too: it turns with the robot.
    cli(moving.folder, "--no-pictures", "--json", "r.json", *given(moving)[:4])
    assert abs(links(tmp_path / "r.json")["tx2"]["azimuth_deg"] - with_both["azimuth_deg"]) > 1


def test_a_trajectory_on_another_clock_says_by_how_much(cli: Cli, moving: RunFolder) -> None:
    outcome = cli(moving.folder, "--no-pictures", *given(moving)[:2])
    assert outcome.code == 1 and one_line(outcome)
    assert "beacon.tum" in outcome.err and "+38.200 s to the receiver's" in outcome.err


def test_such_a_run_is_imported_and_exported_with_all_it_needs(moving: RunFolder, tmp_path: Path) -> None:
    (run,) = find_runs(moving.folder)
    run = replace(run, tx_trajectories={"tx2": moving.folder / "beacon.tum"})
    options = Options(time_offset_s=0.0, tx_time_offsets_s={"tx2": CLOCK_S}, tx_levers_m={"tx2": LEVER_M})
    import_run(run, tmp_path / "log.mcap", options)
    session = open_session(tmp_path / "log.mcap")
    direct = as_json([analyze_run(run, options)])["runs"][0]["links"][0]  # type: ignore[index]
    logged = as_json([analyze_session(session)])["runs"][0]["links"][0]  # type: ignore[index]
    assert logged["azimuth_deg"] == pytest.approx(direct["azimuth_deg"], abs=1e-3)
    assert direct["azimuth_deg"] == pytest.approx(RIGHT_DEG, abs=1.5)
    back, _ = export_run(session, tmp_path / "back")
    assert [path.name for path in back.tx_trajectories.values()] == [f"tx2_tx_trajectory_{STAMP}_.csv"]


def test_an_offset_puts_the_trajectory_on_the_packets_clock(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    late = [line.split(",", 1) for line in run.trajectory.read_text().splitlines()]
    run.trajectory.write_text("".join(f"{float(t) - START_S:.6f},{rest}\n" for t, rest in late))
    outcome = cli(run.folder, "--no-pictures")
    assert outcome.code == 1 and one_line(outcome) and "--time-offset puts them there" in outcome.err
    assert cli(run.folder, "--no-pictures", "--json", "r.json", "--time-offset", str(START_S)).code == 0
    assert links(tmp_path / "r.json")["tx2"]["azimuth_error_deg"] == pytest.approx(0, abs=1)
    (found,) = find_runs(run.folder)
    import_run(found, tmp_path / "log.mcap", Options(time_offset_s=START_S))
    (link,) = analyze_session(open_session(tmp_path / "log.mcap")).links
    assert link.azimuth_error_rad == pytest.approx(0, abs=0.02)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--tx-traj", "tx9=a.tum"], "tx9 is none of the transmitters: tx2"),
        (["--tx-traj", "a.tum"], "expected NAME=FILE"),
        (["--tx-traj", "tx2=a", "--tx-traj", "tx2=b"], "tx2 has already been given a"),
        (["--tx-time-offset", "tx2=1"], "none of the transmitters with --tx-traj: none"),
        (["--tx-traj", "tx2=a", "--tx-time-offset", "tx2=nan"], "expected finite seconds"),
        (["--tx-traj", "tx2=a", "--tx-lever", "tx2=1,2"], "expected three finite lengths"),
        (["--time-offset", "inf"], "expected finite seconds"),
    ],
)
def test_options_that_fit_nothing_are_usage_errors(cli: Cli, run: RunFolder, arguments: list[str], reason: str) -> None:
    outcome = cli(run.folder, "--no-pictures", *arguments)
    assert outcome.code == 2 and reason in outcome.err


def test_a_transmitters_trajectory_is_of_one_run(cli: Cli, run: RunFolder) -> None:
    for path in list(run.folder.glob(f"*{STAMP}*")):
        path.with_name(path.name.replace(STAMP, "2026-01-02_999999")).write_bytes(path.read_bytes())
    outcome = cli(run.folder, "--no-pictures", "--tx-traj", "tx2=a")
    assert outcome.code == 2 and "2 are chosen" in outcome.err


@pytest.mark.parametrize("step_s", [-0.4, -0.05, 0.3, -3600.0, 86400.0])
def test_a_host_clock_that_is_set_within_the_run_is_refused(cli: Cli, run: RunFolder, step_s: float) -> None:
    run.rx.write_bytes(later(run.rx.read_bytes(), 250, step_s))
    outcome = cli(run.folder, "--no-pictures")
    assert outcome.code == 1 and one_line(outcome)
    assert f"its host's clock was set {'back' if step_s < 0 else 'forward'} by {abs(step_s):.2f}" in outcome.err


@pytest.mark.parametrize(
    ("others", "named"),
    [
        ([f"rx_trajectory_{STAMP}_ - Copy.csv"], None),
        ([f"rx_trajectory_{STAMP}99_.csv"], None),
        ([f"rx_trajectory_{STAMP}.csv"], "both fit as mocap trajectory"),
        ([f"rx_trajectory_{STAMP}_.tum"], "both fit as mocap trajectory"),
    ],
)
def test_of_several_trajectories_the_exact_name_wins_else_none(
    cli: Cli, run: RunFolder, tmp_path: Path, others: list[str], named: str | None
) -> None:
    for other in others:
        (run.folder / other).write_text(run.trajectory.read_text().replace(",-1.9", ",-1.8"))
    outcome = cli(run.folder, "--no-pictures", "--json", "r.json")
    if named is not None:
        assert outcome.code == 1 and one_line(outcome) and named in outcome.err
        assert run.trajectory.name in outcome.err and others[0] in outcome.err
        return
    assert outcome.code == 0 and f"trajectory {run.trajectory}" in outcome.out
    assert json.loads((tmp_path / "r.json").read_text())["runs"][0]["trajectory"] == str(run.trajectory)


def test_two_copies_without_the_exact_one_are_both_named(cli: Cli, run: RunFolder) -> None:
    for copy in (" - Copy", " - Copy (2)"):
        run.trajectory.with_name(f"rx_trajectory_{STAMP}_{copy}.csv").write_text(run.trajectory.read_text())
    run.trajectory.unlink()
    outcome = cli(run.folder, "--no-pictures")
    assert outcome.code == 1 and " - Copy (2).csv and " in outcome.err and " - Copy.csv both fit" in outcome.err


def test_our_own_tum_is_our_input(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    (found,) = find_runs(run.folder)
    import_run(found, tmp_path / "log.mcap", Options())
    (tum,) = export(open_session(tmp_path / "log.mcap"), ["tum"], tmp_path / "files")
    before = cli(run.folder, "--no-pictures", "--json", "a.json")
    after = cli(
        "--rx", run.rx, "--tx", run.tx, "--traj", tum, "--poses", "mocap", "--no-pictures", "--json", "b.json",
    )  # fmt: skip
    assert (before.code, after.code) == (0, 0), after.err
    first, second = (links(tmp_path / name)["tx2"] for name in ("a.json", "b.json"))
    assert second["azimuth_deg"] == pytest.approx(first["azimuth_deg"], abs=0.01)


def test_the_synthetic_ways_are_what_the_tests_say() -> None:
    middle = path_m(np.linspace(0.1, 3.9, 500)).mean(axis=0)
    assert np.degrees(np.arctan2(TX_PLACE[1] - middle[1], TX_PLACE[0] - middle[0])) == pytest.approx(RIGHT_DEG, abs=0.2)
    assert np.abs(moves_m(np.linspace(0.1, 3.9, 500)).mean(axis=0)).max() < 0.01
