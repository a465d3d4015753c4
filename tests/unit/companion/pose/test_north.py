"""Where North is: the circular mean over a still period, and the refusals."""

from __future__ import annotations

import math
import random

import pytest

from companion.config.schema import PoseConfig
from companion.core.clock import NS_PER_S, ManualClock
from companion.core.messages import Pose
from companion.pose.intake import PoseIntake
from companion.pose.north import North, NorthFinder, circular_mean
from wsr.geometry import quaternion_from_yaw


def _pose(t_ns: int, yaw_rad: float, x_m: float = 0.0) -> Pose:
    w, x, y, z = quaternion_from_yaw(yaw_rad).tolist()
    return Pose(t_ns, (x_m, 0.0, 0.0), (w, x, y, z), (0.1, 0.1, 0.1), 3)


def _fed(north_rad: float, scatter_rad: float, seconds: float, moving_at: int = -1) -> NorthFinder:
    finder, rng = NorthFinder(), random.Random(3)
    for index in range(round(seconds * 20)):
        t_ns = index * NS_PER_S // 20
        tracker_rad = 0.3 + 0.001 * index
        heading_rad = math.remainder(tracker_rad + north_rad + rng.gauss(0, scatter_rad), math.tau)
        finder.add(t_ns, heading_rad, _pose(t_ns, tracker_rad, 0.5 if index == moving_at else 0.0))
    return finder


@pytest.mark.parametrize("north_deg", [0, 40, 179.5, -179.5, -90])
def test_the_mean_turn_is_found_across_the_seam(north_deg: float) -> None:
    north = _fed(math.radians(north_deg), math.radians(1.0), 4.0).north()
    assert isinstance(north, North)
    assert abs(math.remainder(north.yaw_rad - math.radians(north_deg), math.tau)) < math.radians(0.5)
    assert north.scatter_rad == pytest.approx(math.radians(1.0), rel=0.3)


def test_a_scattered_heading_is_refused() -> None:
    refusal = _fed(0.5, math.radians(6.0), 4.0).north()
    assert isinstance(refusal, str) and "scatters by" in refusal and "more than 3" in refusal


def test_a_short_period_or_one_with_motion_is_not_enough() -> None:
    assert "is not known yet" in str(_fed(0.5, 0.0, 2.0).north())
    assert "is not known yet" in str(_fed(0.5, 0.0, 4.0, moving_at=60).north())


def test_circular_mean_of_opposite_angles_has_no_direction() -> None:
    assert circular_mean([0.0, math.pi])[1] > 5
    assert circular_mean([3.1, -3.1])[0] == pytest.approx(math.pi, abs=1e-9)


class _Source:
    """A source that a test drives by hand."""

    received = malformed = resets = 0
    turned_rad = 0.0

    def align(self, north_yaw_rad: float) -> None:
        self.turned_rad = north_yaw_rad

    async def run(self) -> None:
        raise NotImplementedError

    def close(self) -> None:
        raise NotImplementedError


def _intake(config: PoseConfig) -> tuple[PoseIntake, _Source, ManualClock, list[Pose]]:
    clock, got, source = ManualClock(NS_PER_S), list[Pose](), _Source()
    intake = PoseIntake(config, clock, source, got.append)
    return intake, source, clock, got


def _rest(intake: PoseIntake, source: _Source, clock: ManualClock, tracker_rad: float, heading_rad: float) -> None:
    for _ in range(80):
        clock.advance(0.05)
        intake.take(_pose(clock.now_ns(), tracker_rad + source.turned_rad))
        intake.add_heading(clock.now_ns(), heading_rad)


def test_poses_wait_until_the_autopilots_heading_has_told_where_north_is() -> None:
    intake, source, clock, got = _intake(PoseConfig(north="autopilot"))
    intake.take(_pose(clock.now_ns(), 0.0))
    assert not got and math.isinf(intake.age_s()) and "North is not known yet" in intake.north_problem()
    _rest(intake, source, clock, 0.2, 1.5)
    assert source.turned_rad == pytest.approx(1.3, abs=1e-6) and intake.north_problem() == ""
    assert got and intake.age_s() == 0


def test_a_tracker_that_began_anew_is_turned_again_even_where_config_gave_the_first_turn() -> None:
    intake, source, clock, got = _intake(PoseConfig(north_yaw_deg=40.0))
    source.align(math.radians(40.0))
    intake.take(_pose(clock.now_ns(), 0.0))
    assert len(got) == 1 and intake.reset_counter == 0
    source.resets = 1
    clock.advance(0.05)
    intake.take(_pose(clock.now_ns(), 0.0))
    assert len(got) == 1 and intake.reset_counter == 1
    _rest(intake, source, clock, -0.7, 2.0)
    assert source.turned_rad == pytest.approx(2.7, abs=1e-6)
    assert len(got) > 1 and intake.problem_between(0, clock.now_ns()) == "poses: the tracker began anew"


def test_a_jump_raises_the_reset_counter_and_goes_on() -> None:
    intake, _, clock, got = _intake(PoseConfig())
    for x in (0.0, 1.0):
        clock.advance(0.05)
        intake.take(Pose(clock.now_ns(), (x, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 3))
    assert len(got) == 2 and intake.reset_counter == 1 and intake.report()["jump"] == 1
