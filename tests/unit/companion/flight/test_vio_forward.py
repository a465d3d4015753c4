"""Without GPS our poses are the vehicle's position: a jump of the tracker must not reach it."""

from __future__ import annotations

import itertools
import math

import pytest

from companion.autopilot.port import AutopilotError
from companion.config.schema import PoseConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Pose, Vector3, VehicleState
from companion.flight.vio_forward import VioForwarder
from companion.pose.autopilot import AutopilotPoses
from companion.pose.intake import PoseIntake
from tests.manual_clock import ManualClock

_HZ = 200
_STEP_NS = NS_PER_S // _HZ


class _Intake:
    reset_counter = 0


class _Autopilot:
    """Keeps what it is sent; where it says it is, a test says."""

    def __init__(self) -> None:
        self.sent: list[tuple[Pose, int]] = []
        self.vehicle = VehicleState(t_mono_ns=0)

    def state(self) -> VehicleState:
        return self.vehicle

    def send_odometry(self, pose: Pose, reset_counter: int) -> None:
        self.sent.append((pose, reset_counter))


class _Tracker:
    """Flies East at 0.5 m/s, in a frame that a test moves."""

    def __init__(self, rate_hz: float = 50.0) -> None:
        self.autopilot, self.intake = _Autopilot(), _Intake()
        self.forwarder = VioForwarder(self.autopilot, self.intake, rate_hz)  # type: ignore[arg-type]
        self.t_ns = 0
        self.frame_m: Vector3 = (0.0, 0.0, 0.0)

    @property
    def true_m(self) -> Vector3:
        return 0.5 * self.t_ns / NS_PER_S, 0.0, 1.5

    def jump(self, x: float, y: float, z: float) -> None:
        self.frame_m = (x, y, z)
        self.intake.reset_counter += 1

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * _HZ)):
            self.t_ns += _STEP_NS
            x, y, z = (p + f for p, f in zip(self.true_m, self.frame_m, strict=True))
            self.forwarder.forward(
                Pose(
                    t_mono_ns=self.t_ns,
                    p_enu_m=(x, y, z),
                    q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
                    v_enu_m_s=(0.5, 0.0, 0.0),
                    confidence=3,
                )
            )


@pytest.mark.parametrize("jump_m", [(1.0, 0.0, 0.0), (-3.0, 2.0, -0.7), (0.15, 0.0, 0.0)])
def test_a_jump_is_taken_out_and_nothing_is_reset_by_it(jump_m: Vector3) -> None:
    tracker = _Tracker()
    tracker.run(1.0)
    tracker.jump(*jump_m)
    tracker.run(1.0)
    sent = [pose for pose, _ in tracker.autopilot.sent]
    assert len(sent) == pytest.approx(100, abs=2)
    steps_m = [math.dist(a.p_enu_m, b.p_enu_m) for a, b in itertools.pairwise(sent)]
    assert max(steps_m) < 0.02
    assert sent[-1].p_enu_m == pytest.approx((0.5 * sent[-1].t_mono_ns / NS_PER_S, 0.0, 1.5), abs=1e-6)
    assert {counter for _, counter in tracker.autopilot.sent} == {0}


def test_jumps_add_up_to_nothing() -> None:
    tracker = _Tracker()
    for place_m in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, -2.0, 0.0), (0.0, 0.0, 0.0)):
        tracker.run(0.5)
        tracker.jump(*place_m)
    tracker.run(0.5)
    newest, _ = tracker.autopilot.sent[-1]
    assert newest.p_enu_m[1:] == pytest.approx((0.0, 1.5), abs=1e-6)


def test_after_a_gap_the_autopilot_knows_where_it_is() -> None:
    tracker = _Tracker()
    tracker.run(1.0)
    tracker.t_ns += 2 * NS_PER_S
    tracker.jump(7.0, 0.0, 0.0)
    tracker.autopilot.vehicle = VehicleState(
        t_mono_ns=tracker.t_ns,
        position_mono_ns=tracker.t_ns + _STEP_NS,
        p_local_enu_m=(1.2, 0.1, 1.4),
        v_local_enu_m_s=(0.0, 0.0, 0.0),
    )
    tracker.run(1 / _HZ)
    assert tracker.autopilot.sent[-1][0].p_enu_m == pytest.approx((1.2, 0.1, 1.4))


def test_the_vehicle_where_none_is_known_stays_where_it_was() -> None:
    tracker = _Tracker()
    tracker.run(1.0)
    tracker.t_ns += 2 * NS_PER_S
    tracker.jump(7.0, 0.0, 0.0)
    tracker.run(1 / _HZ)
    assert tracker.autopilot.sent[-1][0].p_enu_m == pytest.approx((0.5, 0.0, 1.5))


def test_without_a_rate_nothing_is_sent() -> None:
    tracker = _Tracker(rate_hz=0.0)
    tracker.run(0.5)
    assert tracker.autopilot.sent == []


_EAST = (1.0, 0.0, 0.0, 0.0)


class _Estimator:
    def __init__(self) -> None:
        self.got: list[tuple[Pose, int]] = []
        self.fails = False

    def send_odometry(self, pose: Pose, reset_counter: int) -> None:
        if self.fails:
            raise AutopilotError("not connected")
        self.got.append((pose, reset_counter))


def _forward(estimator: _Estimator, rate_hz: float, seconds: float, confidence: int = 3) -> VioForwarder:
    intake = PoseIntake(PoseConfig(), ManualClock(), AutopilotPoses(lambda _: None), lambda _: None)
    forwarder = VioForwarder(estimator, intake, rate_hz)  # type: ignore[arg-type]
    for index in range(round(200 * seconds)):
        forwarder.forward(
            Pose(
                t_mono_ns=10**9 + index * 5_000_000,
                p_enu_m=(0.0, 0.0, 0.0),
                q_enu_from_body=_EAST,
                v_enu_m_s=(0.0, 0.0, 0.0),
                confidence=confidence,
            )
        )
    return forwarder


@pytest.mark.parametrize(("rate_hz", "expected"), [(30.0, 30), (50.0, 50), (0.0, 0), (100.0, 100)])
def test_the_forwarder_keeps_its_rate(rate_hz: float, expected: int) -> None:
    estimator = _Estimator()
    assert _forward(estimator, rate_hz, 2.0).sent == pytest.approx(2 * expected, abs=2)


def test_the_forwarder_never_sends_a_failed_pose_and_survives_a_lost_link() -> None:
    estimator = _Estimator()
    assert _forward(estimator, 30.0, 1.0, confidence=0).sent == 0
    estimator.fails = True
    forwarder = _forward(estimator, 30.0, 1.0)
    assert forwarder.sent == 0 and forwarder.failed > 20
