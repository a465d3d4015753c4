"""What makes poses untrustworthy, one by one, and what an aperture makes of it."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.clock import NS_PER_S
from companion.core.messages import Pose
from companion.pose.health import HealthLimits, PoseHealth

_LEVEL = (1.0, 0.0, 0.0, 0.0)
_STEP_NS = NS_PER_S // 200


class _Stream:
    """A tracker at 200 Hz that moves East at 0.4 m/s, into a health."""

    def __init__(self) -> None:
        self.health = PoseHealth(HealthLimits())
        self.now_ns = 100 * NS_PER_S
        self.pose = Pose(
            t_mono_ns=self.now_ns,
            p_enu_m=(0.0, 0.0, 1.0),
            q_enu_from_body=_LEVEL,
            v_enu_m_s=(0.4, 0.0, 0.0),
            confidence=3,
        )

    def run(self, seconds: float, **changes: object) -> None:
        for _ in range(round(seconds * 200)):
            self.now_ns += _STEP_NS
            x, y, z = self.pose.p_enu_m
            self.pose = replace(self.pose, t_mono_ns=self.now_ns, p_enu_m=(x + 0.002, y, z))
            self.health.take(replace(self.pose, **changes), self.now_ns)  # type: ignore[arg-type]

    def problem_since(self, start_ns: int) -> str:
        return self.health.problem_between(start_ns, self.now_ns)


@pytest.fixture
def stream() -> _Stream:
    started = _Stream()
    started.run(1.5)
    return started


def test_a_good_stream_has_no_problem(stream: _Stream) -> None:
    status = stream.health.status(stream.now_ns)
    assert status.problem == "" and status.rate_hz == pytest.approx(200, abs=2) and status.confidence == 3
    assert stream.problem_since(stream.now_ns - NS_PER_S) == ""
    assert not any(stream.health.counts.values())


def test_fault_16_nan_is_refused_and_lost_within_a_tenth_of_a_second(stream: _Stream) -> None:
    start_ns = stream.now_ns
    stream.run(0.04, p_enu_m=(math.nan, 0.0, 0.0))
    assert not stream.health.is_lost(stream.now_ns - _STEP_NS)
    stream.run(0.01, p_enu_m=(math.nan, 0.0, 0.0))
    assert stream.health.is_lost(stream.now_ns)
    assert stream.health.newest is not None and math.isfinite(stream.health.newest.p_enu_m[0])
    stream.run(0.01)
    assert not stream.health.is_lost(stream.now_ns), "a tracker that came back is not lost"
    assert stream.problem_since(start_ns) == "poses: not finite"


@pytest.mark.parametrize(
    ("q", "is_tipped"),
    [
        ((0.5**0.5, 0.5**0.5, 0.0, 0.0), True),  # on its side: Motive's Z up taken for Y up, the nose turned by 90 deg
        ((0.0, 0.0, 1.0, 0.0), True),  # on its back
        ((math.cos(math.radians(29)), 0.0, math.sin(math.radians(29)), 0.0), False),  # a hard bank
        ((0.5**0.5, 0.0, 0.0, 0.5**0.5), False),  # turned about Up
    ],
)
def test_a_robot_that_lies_on_its_side_has_wrong_axes(stream: _Stream, q: tuple[float, ...], is_tipped: bool) -> None:
    stream.run(0.1, q_enu_from_body=q)
    problem = stream.health.status(stream.now_ns).problem
    assert ("lies on its side or back: pose.natnet.up" in problem) is is_tipped and bool(problem) is is_tipped


@pytest.mark.parametrize("changes", [{"v_enu_m_s": (0.0, math.inf, 0.0)}, {"q_enu_from_body": (0.0, 0.0, 0.0, 0.0)}])
def test_any_number_that_is_none_makes_a_pose_unusable(stream: _Stream, changes: dict[str, object]) -> None:
    stream.run(0.1, **changes)
    assert stream.health.counts["not finite"] == 20 and stream.health.is_lost(stream.now_ns)


def test_a_failed_tracker_is_no_source_of_poses(stream: _Stream) -> None:
    stream.run(0.1, confidence=0)
    assert stream.health.is_lost(stream.now_ns) and stream.health.age_s(stream.now_ns) == pytest.approx(0.1)


def test_low_confidence_can_be_flown_with_but_not_measured_with(stream: _Stream) -> None:
    start_ns = stream.now_ns
    stream.run(0.1, confidence=1)
    assert stream.health.age_s(stream.now_ns) == 0
    assert stream.health.status(stream.now_ns).problem == "tracker confidence 1"
    assert stream.problem_since(start_ns) == "poses: low confidence"


def test_fault_17_a_gap_is_stale_at_a_fifth_of_a_second(stream: _Stream) -> None:
    start_ns = stream.now_ns
    stream.now_ns += 190_000_000
    assert stream.health.status(stream.now_ns).problem == "" and stream.problem_since(start_ns) == ""
    stream.now_ns += 20_000_000
    assert stream.health.status(stream.now_ns).problem == "poses are 0.2 s old"
    assert stream.problem_since(start_ns) == "poses: gap"
    stream.now_ns += 5 * NS_PER_S
    stream.run(1.5)
    assert stream.health.status(stream.now_ns).problem == ""
    assert stream.problem_since(start_ns) == "poses: gap", "an aperture that the gap touches stays dropped"
    assert stream.problem_since(stream.now_ns - NS_PER_S) == ""


def test_a_gap_that_the_vehicle_could_have_flown_is_no_jump(stream: _Stream) -> None:
    stream.now_ns += NS_PER_S
    stream.pose = replace(stream.pose, p_enu_m=(5.0, 0.0, 1.0))
    stream.run(0.1)
    assert (stream.health.counts["gap"], stream.health.counts["jump"]) == (1, 0)


@pytest.mark.parametrize(("metres", "jumps"), [(1.0, 1), (0.11, 1), (0.09, 0)])
def test_fault_18_a_jump_spoils_what_it_touches(stream: _Stream, metres: float, jumps: int) -> None:
    start_ns = stream.now_ns
    x, y, z = stream.pose.p_enu_m
    stream.pose = replace(stream.pose, p_enu_m=(x, y + metres, z))
    stream.run(0.5)
    assert stream.health.counts["jump"] == jumps
    assert stream.problem_since(start_ns) == ("poses: jump" if jumps else "")
    assert stream.problem_since(start_ns + NS_PER_S // 4) == ""


def test_slow_speed_limits_catch_a_jump_over_a_short_step(stream: _Stream) -> None:
    """0.09 m within 4 ms is 22 m/s, though less than 0.1 m."""
    x, y, z = stream.pose.p_enu_m
    stream.health.take(
        replace(stream.pose, t_mono_ns=stream.now_ns + 4_000_000, p_enu_m=(x, y + 0.09, z)), stream.now_ns
    )
    assert stream.health.counts["jump"] == 1


def test_a_tracker_that_claims_to_move_and_does_not_is_a_stall(stream: _Stream) -> None:
    start_ns = stream.now_ns
    frozen = stream.pose.p_enu_m
    stream.run(0.4, p_enu_m=frozen)
    assert stream.problem_since(start_ns) == ""
    stream.run(0.2, p_enu_m=frozen)
    assert stream.problem_since(start_ns) == "poses: stall"


def test_a_vehicle_at_rest_is_no_stall(stream: _Stream) -> None:
    stream.run(2.0, p_enu_m=stream.pose.p_enu_m, v_enu_m_s=(0.0, 0.0, 0.0))
    assert stream.health.counts["stall"] == 0


def test_a_slow_stream_is_told(stream: _Stream) -> None:
    for _ in range(15):
        stream.now_ns += NS_PER_S // 10
        stream.health.take(replace(stream.pose, t_mono_ns=stream.now_ns), stream.now_ns)
    assert stream.health.status(stream.now_ns).problem == "only 10 poses a second"
    assert stream.problem_since(stream.now_ns - NS_PER_S // 2) == "poses: low rate", "though no gap is long"


def test_a_slow_start_is_no_low_rate(stream: _Stream) -> None:
    stream.health.note_reset(stream.now_ns)
    stream.now_ns += 5 * NS_PER_S
    start_ns = stream.now_ns
    stream.run(3.0)
    assert stream.health.counts["low rate"] == 0 and stream.problem_since(start_ns) == ""


def test_a_pose_of_a_time_to_come_is_not_used_and_leaves_nothing_behind(stream: _Stream) -> None:
    """Taken, it would have looked fresh for an hour, while every true pose came too late after it."""
    start_ns = stream.now_ns
    assert not stream.health.take(replace(stream.pose, t_mono_ns=stream.now_ns + 3600 * NS_PER_S), stream.now_ns)
    assert not stream.health.take(replace(stream.pose, t_mono_ns=stream.now_ns + 51_000_000), stream.now_ns)
    stream.run(0.5)
    assert stream.health.counts["future"] == 2 and stream.health.counts["disorder"] == 0
    assert 0 <= stream.health.age_s(stream.now_ns) < 0.01 and not stream.health.is_lost(stream.now_ns)
    assert stream.problem_since(start_ns) == "poses: future"
    stream.now_ns += NS_PER_S
    assert stream.health.age_s(stream.now_ns) == pytest.approx(1.0), "silence after it is seen"


def test_a_tracker_whose_clock_runs_ahead_has_lost_itself(stream: _Stream) -> None:
    for _ in range(20):
        stream.now_ns += _STEP_NS
        stream.health.take(replace(stream.pose, t_mono_ns=stream.now_ns + NS_PER_S), stream.now_ns)
    assert stream.health.is_lost(stream.now_ns)


def test_poses_out_of_order_are_not_used(stream: _Stream) -> None:
    assert not stream.health.take(replace(stream.pose, t_mono_ns=stream.now_ns - 1), stream.now_ns)
    assert not stream.health.take(stream.pose, stream.now_ns)
    assert stream.health.counts["disorder"] == 2


def test_before_the_first_pose_everything_is_missing() -> None:
    health = PoseHealth(HealthLimits())
    assert health.status(0).problem == "no poses" and health.problem_between(0, 1) == "poses: gap"
    assert math.isinf(health.age_s(0)) and not health.is_lost(0)


def test_a_bad_minute_does_not_push_out_what_was_before(stream: _Stream) -> None:
    start_ns = stream.now_ns
    stream.run(0.02, confidence=1)
    mark_ns = stream.now_ns
    stream.run(0.5)
    stream.run(60.0, p_enu_m=(math.nan, 0.0, 0.0))
    assert stream.health.problem_between(start_ns, mark_ns) == "poses: low confidence"
