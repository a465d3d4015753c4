"""What PX4 1.16.1's estimator does at rest, in the air, with vision alone and without it, as seen on a real one."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.core.messages import Vector3
from companion.sim.px4.commander import Mode
from tests.unit.companion.sim.px4.client import GPS_DENIED, HOLD, LAND, OFFBOARD, Client, Seeing

_ARM, _TAKEOFF = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_NAV_TAKEOFF


def _flying(client: Seeing) -> Seeing:
    """In OFFBOARD at 2 m with vision and an origin."""
    client.run(1)
    client.set_origin()
    client.run(1)
    client.take_off()
    client.go_offboard()
    client.run(3, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    return client


def test_constant_position_is_set_at_rest_and_not_once_armed() -> None:
    client = Client()
    client.run(2)
    assert client.flags() == 1023
    client.command(_ARM, 1)
    client.run(1.1)
    assert client.flags() == 895
    client.take_off()
    assert client.flags() == 895


def test_flags_with_vision_alone() -> None:
    client = Seeing()
    client.sees = False
    client.run(2)
    assert client.flags() == 229
    client.sees = True
    client.run(1.1)
    assert client.flags() == 495
    client.set_mode((4, 2))
    assert client.command(_ARM, 1) == [0]
    client.run(1.1)
    assert client.flags() == 367


def test_without_a_global_position_hold_cannot_be_flown_nor_armed_in() -> None:
    client = Seeing()
    client.run(2)
    assert client.command(_ARM, 1) == [1]
    client.run(1)
    assert "resolve system health failures" in client.messages("STATUSTEXT")[-1].text
    assert client.messages("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_UNINIT
    assert not client.messages("GLOBAL_POSITION_INT") and not client.messages("HOME_POSITION")
    assert client.command(_TAKEOFF) == [0] and client.command(_ARM, 1) == [0]
    client.run(8)
    assert client.mode() is Mode.TAKEOFF, "its takeoff never ends, since hold is what it ends in"
    assert client.truth_m()[2] == pytest.approx(2.0, abs=0.1)
    assert client.set_mode(HOLD) == [0, 1]
    assert client.set_mode(LAND) == [0, 0]


def test_an_origin_and_north_aligned_poses_make_it_global() -> None:
    client = Seeing()
    client.run(2)
    client.set_origin()
    client.run(1)
    assert client.messages("GPS_GLOBAL_ORIGIN") and client.messages("GLOBAL_POSITION_INT")
    assert client.flags() & 16
    client.take_off()
    assert client.set_mode(HOLD) == [0, 0]


def test_local_frd_takes_yaw_alignment_and_with_it_the_global_position_away() -> None:
    client = Seeing()
    client.frame = mavlink.MAV_FRAME_LOCAL_FRD
    client.set_origin()
    client.run(2)
    assert not client.px4.commander.estimator.has_global_position
    assert client.command(_ARM, 1) == [1]


def test_the_estimate_is_what_vision_says() -> None:
    client = Seeing()
    client.off_m = (1.0, -2.0, 0.25)
    client.run(2)
    position = client.messages("LOCAL_POSITION_NED")[-1]
    assert (position.x, position.y, position.z) == pytest.approx((-2.0, 1.0, -0.25), abs=0.01)
    assert client.truth_m() == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("kind", ["jump", "slip"])
def test_without_gps_vision_that_is_wrong_moves_the_vehicle(kind: str) -> None:
    client = _flying(Seeing())
    before = client.px4.commander.estimator.resets
    for step in range(10 if kind == "slip" else 1):
        client.off_m = (1.0, 0.0, 0.0) if kind == "jump" else (0.1 * (step + 1), 0.0, 0.0)
        client.run(0.4, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    client.run(1.0, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    if kind == "jump":
        assert 0.3 < -client.px4.commander.airframe.v_enu_m_s[0] < 1.0
    client.run(5, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    assert client.truth_m()[0] == pytest.approx(-1.0, abs=0.06)
    announced = client.px4.commander.estimator.resets - before
    assert announced == (1 if kind == "jump" else 0)
    assert client.messages("ODOMETRY")[-1].reset_counter == client.px4.commander.estimator.resets


def test_with_gps_vision_moves_nothing_and_a_reset_does() -> None:
    client = Seeing(parameters={"MIS_TAKEOFF_ALT": 2.0, "EKF2_EV_CTRL": 0})
    client.take_off()
    client.go_offboard()
    client.off_m = (1.0, 0.0, 0.0)
    client.run(5, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    assert client.truth_m()[0] == pytest.approx(0.0, abs=0.05)
    before = client.messages("ODOMETRY")[-1].reset_counter
    client.order("reset 5 0 0")
    client.run(10, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    assert client.truth_m()[0] == pytest.approx(-5.0, abs=0.1), "it flies to where the old point is now"
    assert client.messages("ODOMETRY")[-1].reset_counter == before + 1


@pytest.mark.parametrize(("altitude_m", "up_m"), [(0.0, 0.0), (488.0, -488.0)])
def test_a_raised_reset_counter_moves_the_estimate_by_the_origins_altitude(altitude_m: float, up_m: float) -> None:
    client = Seeing()
    client.run(1)
    client.set_origin(altitude_m)
    client.run(1)
    client.reset_counter = 1
    client.run(0.05)
    assert client.estimate_m()[2] == pytest.approx(up_m, abs=0.05)


def test_vision_lost_in_flight_drifts_and_lands_blind() -> None:
    client = _flying(Seeing())
    client.sees = False
    client.run(4.4, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    assert client.mode() is Mode.OFFBOARD and client.flags() == 127
    assert 0.5 < abs(client.truth_m()[0]) < 3.0, "it follows an estimate that drifts"
    client.run(0.4, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    assert client.mode() is Mode.LAND and client.px4.commander.failsafe
    client.run(14, stream_hz=20)
    assert not client.px4.commander.armed and client.mode() is Mode.OFFBOARD
    assert client.flags() == 229


def test_stamps_count_only_once_timesync_has_converged_and_then_wrong_ones_lose_vision() -> None:
    client = _flying(Seeing())
    client.stamp_ahead_s = 6800.0
    client.run(10, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    assert client.mode() is Mode.OFFBOARD, "stamped on arrival so far"
    for _ in range(501):  # a companion answers with the vehicle's own time, as MAVSDK does
        own_ns = client.px4.link.clock.ns(client.now_ns)
        client.send(mavlink.MAVLink_timesync_message(own_ns, own_ns))
    client.run(6, stream_hz=20, point=(0, 0, -2, 0, 0, 0, 0))
    assert client.mode() is Mode.LAND
    client.stamp_ahead_s = -0.015
    client.run(1)
    assert client.px4.commander.estimator.has_local_position


def test_vision_is_dropped_where_parameters_or_times_say_so() -> None:
    client = Seeing(parameters=GPS_DENIED | {"EKF2_EV_CTRL": 0})
    client.run(1)
    report = client.px4.report(client.now_ns)
    assert report.vision > 20 and report.vision_fused == 0 and report.vision_dropped == report.vision


def test_up_wanders_half_a_metre_before_the_takeoff_and_no_more_in_the_air() -> None:
    client = Client(drift_m=0.5, parameters={"MIS_TAKEOFF_ALT": 2.0})
    assert client.px4.commander.airframe.estimated_p_enu_m[2] == 0.0
    client.run(60)
    drifted_m = client.px4.commander.airframe.estimated_p_enu_m[2]
    assert 0.4 < drifted_m < 0.5
    client.take_off()
    error = client.px4.commander.airframe.estimated_p_enu_m[2] - client.px4.commander.airframe.p_enu_m[2]
    assert error == pytest.approx(drifted_m, abs=0.01)
    assert client.px4.commander.airframe.p_enu_m[2] == pytest.approx(2.0, abs=0.2), "above the ground it took off from"


def test_with_gps_the_estimate_wanders_in_flight_and_the_vehicle_with_it() -> None:
    client = Client(seed=5, parameters={"MIS_TAKEOFF_ALT": 2.0})
    client.run(30)
    assert _off_m(client) < 0.15, "on the ground it is off by what gusts' estimator is, no more"
    client.take_off()
    off_m, steps_m = [], []
    for _ in range(600):
        before = np.subtract(*_estimated_and_true_m(client))
        client.run(0.1)
        steps_m.append(float(np.abs(np.subtract(*_estimated_and_true_m(client)) - before).max()))
        off_m.append(_off_m(client))
    assert 0.2 < max(off_m) < 1.5
    assert max(steps_m) < 0.05, "nothing that looks like a reset"
    assert client.px4.commander.estimator.resets == 0


def test_position_lost_by_gps_lands_too() -> None:
    client = Client(parameters={"COM_OBL_RC_ACT": 5})
    client.take_off()
    client.go_offboard()
    client.order("estimator unhealthy")
    client.run(1.1, stream_hz=20)
    assert client.mode() is Mode.LAND, "hold cannot be flown without a position"
    assert client.set_mode(OFFBOARD) == [0, 1]


def _estimated_and_true_m(client: Client) -> tuple[Vector3, Vector3]:
    airframe = client.px4.commander.airframe
    return airframe.estimated_p_enu_m, airframe.p_enu_m


def _off_m(client: Client) -> float:
    return math.dist(*_estimated_and_true_m(client))
