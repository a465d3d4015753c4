"""What the links of a run have in common: which files it needs, and clocks and places that cannot belong together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.analysis.exchanges import read_log
from companion.analysis.result import NO_LEVER, Options
from companion.analysis.runs import RecordingError, Run, find_runs
from companion.analysis.scene import (
    RunScene,
    check_clock,
    lever_of,
    missing_files,
    read_scene,
    second_choice,
    truth_of,
    without_log,
)
from companion.analysis.trajectories import PoseKind, read_trajectory
from tests.synthetic_run import TX_MAC, RunFolder


def _found(run: RunFolder) -> Run:
    (found,) = find_runs(run.folder)
    return found


def _scene(found: Run, options: Options | None = None) -> tuple[RunScene, list[str]]:
    problems: list[str] = []
    assert found.rx is not None
    truth, _ = truth_of(found)
    scene = read_scene(found, found.rx, PoseKind.MOCAP, options or Options(), truth=truth, problems=problems)
    return scene, problems


def test_a_whole_run_has_everything_and_nothing_to_complain_of(run: RunFolder) -> None:
    scene, problems = _scene(_found(run))
    assert problems == []
    assert scene.mocap is scene.trajectory
    np.testing.assert_array_equal(scene.p_antenna_m, scene.trajectory.p_enu_m)
    assert scene.wavelength_m == pytest.approx(0.0541, abs=1e-4)
    assert scene.truth is not None
    assert scene.truth.transmitters["tx2"].tolist() == [3.0, 6.0, 2.5]


def test_files_without_which_nothing_can_be_done_are_named(run: RunFolder) -> None:
    found = _found(run)
    assert list(missing_files(found, PoseKind.MOCAP, None)) == []
    bare = replace(found, rx=None, tx={}, trajectories={})
    rx, trajectory, tx = missing_files(bare, PoseKind.MOCAP, None)
    assert f"csi_rx_{found.stamp}.dat is missing" in rx
    assert f"no mocap trajectory of {found.stamp} (available: none)" in trajectory
    assert "of any transmitter" in tx
    assert "no trajectory of" in next(missing_files(replace(found, trajectories={}), None, None))


def test_a_second_choice_of_poses_is_said_unless_it_was_asked_for(run: RunFolder) -> None:
    found = _found(run)
    (told,) = second_choice(found, PoseKind.T265, None)
    assert told.endswith("is missing (motion capture); t265 is used")
    assert list(second_choice(found, PoseKind.T265, PoseKind.T265)) == []
    assert list(second_choice(found, PoseKind.MOCAP, None)) == []


def test_the_antenna_is_where_the_user_says_else_where_the_robot_has_it() -> None:
    assert lever_of(None, Options()) == lever_of(PoseKind.MOCAP, Options()) == NO_LEVER
    assert lever_of(PoseKind.ODOM, Options())[1] == 0.16
    assert lever_of(PoseKind.ODOM, Options(lever_m=(0.0, 0.0, 0.1))) == (0.0, 0.0, 0.1)


def test_a_lever_needs_attitudes(run: RunFolder) -> None:
    with pytest.raises(RecordingError, match="has no attitude, so a lever arm cannot be applied"):
        _scene(_found(run), Options(lever_m=(0.1, 0.0, 0.0)))


def test_a_channel_against_the_truth_is_used_and_said_and_without_any_it_is_asked_for(run: RunFolder) -> None:
    scene, (problem,) = _scene(_found(run), Options(channel=36))
    assert "says channel 108, but 36 was given and is used" in problem
    assert scene.wavelength_m > 0.0575
    with pytest.raises(RecordingError, match="the WiFi channel is not known; give --channel"):
        _scene(replace(_found(run), truth=None))


@pytest.mark.parametrize(
    ("offset_s", "apart"), [(100.0, r"begins 9\d\.\d s after"), (-100.0, r"ends 9\d\.\d s before")]
)
def test_a_trajectory_of_another_time_says_by_how_much(run: RunFolder, offset_s: float, apart: str) -> None:
    with pytest.raises(RecordingError, match=f"no time overlap: the trajectory {apart} the packets"):
        _scene(_found(run), Options(time_offset_s=offset_s))


def test_a_clock_that_was_set_meanwhile_is_refused(run: RunFolder) -> None:
    log, trajectory = read_log(run.rx), read_trajectory(run.trajectory, PoseKind.MOCAP)
    check_clock(log, trajectory)
    stepped = log.host_time_s + np.where(np.arange(len(log)) >= 250, -0.4, 0.0)
    with pytest.raises(
        RecordingError, match=r"its host's clock was set back by 0\.4\d* s about record \d+ of those near rx_trajectory"
    ):
        check_clock(replace(log, host_time_s=stepped), trajectory)


def test_a_transmitter_that_was_heard_and_has_no_log_is_named(run: RunFolder) -> None:
    found, rx = _found(run), read_log(run.rx)
    assert list(without_log(found, rx, Options())) == []
    (missing,) = without_log(replace(found, tx={}), rx, Options())
    assert "csi_tx2_" in missing
    assert "packets of tx2 were heard" in missing
    (asked,) = without_log(replace(found, tx={}), rx, Options(macs={"robot": "00:00:00:00:00:07"}))
    assert asked.endswith(f"no packets of 00:00:00:00:00:07; senders heard: {TX_MAC}")
    assert truth_of(replace(found, truth=None))[1] is not None
