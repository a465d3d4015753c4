"""Poses on their way in: turned to North, counted anew after a jump."""

from __future__ import annotations

import math

import pytest

from companion.config.schema import PoseConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Pose
from companion.host.coalescing import Readers
from companion.pose.intake import PoseIntake
from tests.manual_clock import ManualClock
from tests.unit.companion.pose.turning import yawed_pose


class _Source:
    """A source that a test drives by hand."""

    received = malformed = resets = 0
    turned_rad = 0.0

    def align(self, north_yaw_rad: float) -> None:
        self.turned_rad = north_yaw_rad

    async def run(self, readers: Readers | None = None) -> None:
        raise NotImplementedError

    def close(self) -> None:
        raise NotImplementedError


def _intake(config: PoseConfig) -> tuple[PoseIntake, _Source, ManualClock, list[Pose]]:
    clock, got, source = ManualClock(NS_PER_S), list[Pose](), _Source()
    intake = PoseIntake(config, clock, source, got.append)
    return intake, source, clock, got


def _rest(intake: PoseIntake, source: _Source, clock: ManualClock, tracker_rad: float, *, heading_rad: float) -> None:
    for _ in range(80):
        clock.advance(0.05)
        intake.take(yawed_pose(clock.now_ns(), tracker_rad + source.turned_rad))
        intake.add_heading(clock.now_ns(), heading_rad)


def test_poses_wait_until_the_autopilots_heading_has_told_where_north_is() -> None:
    intake, source, clock, got = _intake(PoseConfig(north="autopilot"))
    intake.take(yawed_pose(clock.now_ns(), 0.0))
    assert not got and math.isinf(intake.age_s()) and "North is not known yet" in intake.north_problem()
    _rest(intake, source, clock, 0.2, heading_rad=1.5)
    assert source.turned_rad == pytest.approx(1.3, abs=1e-6) and intake.north_problem() == ""
    assert got and intake.age_s() == 0


def test_a_tracker_that_began_anew_is_turned_again_even_where_config_gave_the_first_turn() -> None:
    intake, source, clock, got = _intake(PoseConfig(north_yaw_deg=40.0))
    source.align(math.radians(40.0))
    intake.take(yawed_pose(clock.now_ns(), 0.0))
    assert len(got) == 1 and intake.reset_counter == 0
    source.resets = 1
    clock.advance(0.05)
    intake.take(yawed_pose(clock.now_ns(), 0.0))
    assert len(got) == 1 and intake.reset_counter == 1
    _rest(intake, source, clock, -0.7, heading_rad=2.0)
    assert source.turned_rad == pytest.approx(2.7, abs=1e-6)
    assert len(got) > 1 and intake.problem_between(0, clock.now_ns()) == "poses: the tracker began anew"


def test_a_jump_raises_the_reset_counter_and_goes_on() -> None:
    intake, _, clock, got = _intake(PoseConfig())
    for x in (0.0, 1.0):
        clock.advance(0.05)
        intake.take(
            Pose(
                t_mono_ns=clock.now_ns(),
                p_enu_m=(x, 0.0, 0.0),
                q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
                v_enu_m_s=(0.0, 0.0, 0.0),
                confidence=3,
            )
        )
    assert len(got) == 2 and intake.reset_counter == 1 and intake.report()["jump"] == 1
