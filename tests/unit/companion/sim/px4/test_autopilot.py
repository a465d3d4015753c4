"""The mock autopilot keeps each PX4 behaviour that a companion must survive. No sockets, and time is a number."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.core.clock import NS_PER_S
from companion.sim.px4.commander import Mode
from tests.unit.companion.sim.px4.client import HOLD, LAND, OFFBOARD, POSITION_VELOCITY_YAW, Client


@pytest.fixture
def client() -> Client:
    return Client(parameters={"COM_OBL_RC_ACT": 5, "MIS_TAKEOFF_ALT": 1.5})


def test_version_timesync_and_unknown_commands(client: Client) -> None:
    assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == [0]
    assert client.messages("AUTOPILOT_VERSION")[0].flight_sw_version >> 16 == 0x0110
    assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 12345) == [3]
    assert client.command(mavlink.MAV_CMD_DO_PARACHUTE) == [3]
    client.send(mavlink.MAVLink_timesync_message(0, 777))
    answer = client.messages("TIMESYNC")[-1]
    assert answer.ts1 == 777
    assert abs(answer.tc1 - client.now_ns) > NS_PER_S, "its clock is not ours"
    client.run(2.0)
    client.send(mavlink.MAVLink_timesync_message(0, 778))
    assert client.messages("TIMESYNC")[-1].tc1 - answer.tc1 == 2 * NS_PER_S
    client.send(mavlink.MAVLink_timesync_message(5, 6))
    assert client.px4.link.timesync_answers == 1


def test_bytes_that_are_no_mavlink_are_ignored(client: Client) -> None:
    assert client.px4.link.receive(bytes(range(256)) * 4, client.now_ns) == []
    client.set_point(0, 0, -1, 0, 0, 0, 0)
    assert client.px4.commander.stream.received == 1


def test_offboard_is_acknowledged_twice_and_refused_in_the_air_without_a_stream(client: Client) -> None:
    client.take_off()
    assert client.set_mode(OFFBOARD) == [0, 1]
    client.set_point(0, 0, -1, 0, 0, 0, 0)
    assert client.set_mode(OFFBOARD) == [0, 1], "one set point is no stream"
    client.run(3, stream_hz=1.5)
    assert client.set_mode(OFFBOARD) == [0, 1], "slower than 2 Hz is no stream"
    assert client.mode() is Mode.HOLD
    client.run(0.5, stream_hz=20)
    assert client.set_mode(OFFBOARD) == [0, 0]
    assert client.mode() is Mode.OFFBOARD


def test_on_the_ground_offboard_is_taken_without_a_stream_and_arming_in_it_is_not(client: Client) -> None:
    assert client.set_mode(OFFBOARD) == [0, 0]
    client.run(1.1)
    assert client.messages("HEARTBEAT")[-1].custom_mode == 6 << 16
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [1]
    client.run(0.1)
    assert client.messages("STATUSTEXT")[-1].text == "Arming denied: resolve system health failures"


def test_injected_refusal_and_silence(client: Client) -> None:
    client.run(0.5, stream_hz=20)
    assert client.px4.order("offboard refuse") is None
    assert client.set_mode(OFFBOARD) == [0, 1]
    assert client.px4.order("offboard silent") is None
    assert client.set_mode(OFFBOARD) == []
    assert client.mode() is Mode.HOLD


def test_takeoff_hold_land_and_disarm(client: Client) -> None:
    assert client.px4.commander.landed
    client.take_off()
    assert client.px4.commander.airframe.p_enu_m[2] == pytest.approx(1.5, abs=0.3)
    assert client.messages("EXTENDED_SYS_STATE")[-1].landed_state == mavlink.MAV_LANDED_STATE_IN_AIR
    assert client.messages("HEARTBEAT")[-1].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert client.set_mode(LAND) == [0, 0]
    client.run(4)
    assert client.px4.commander.airframe.on_ground
    client.run(5.5)
    assert not client.px4.commander.landed, "it takes PX4 7.7 s from the touch"
    client.run(1.5)
    assert client.px4.commander.landed and client.px4.commander.armed
    client.run(2)
    assert not client.px4.commander.armed
    assert client.mode() is Mode.HOLD


def test_armed_on_the_ground_for_long_disarms(client: Client) -> None:
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
    client.run(9)
    assert client.px4.commander.armed
    client.run(2)
    assert not client.px4.commander.armed


def test_disarming_in_the_air_and_arming_for_a_dead_stream_are_refused(client: Client) -> None:
    client.take_off()
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [2]
    grounded = Client()
    grounded.run(0.5, stream_hz=20)
    assert grounded.set_mode(OFFBOARD) == [0, 0]
    grounded.run(2)
    assert grounded.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [1]


def test_offboard_follows_north_east_down(client: Client) -> None:
    client.take_off()
    client.go_offboard()
    client.run(12, stream_hz=20, point=(3.0, -2.0, -2.5, 0, 0, 0, 0.5))
    airframe = client.px4.commander.airframe
    assert airframe.p_enu_m == pytest.approx((-2.0, 3.0, 2.5), abs=0.02)
    assert math.remainder(airframe.yaw_enu_rad - (math.pi / 2 - 0.5), math.tau) == pytest.approx(0, abs=1e-6)
    position = client.messages("LOCAL_POSITION_NED")[-1]
    assert (position.x, position.y, position.z) == pytest.approx((3.0, -2.0, -2.5), abs=0.02)
    assert client.messages("ATTITUDE")[-1].yaw == pytest.approx(0.5)
    globe = client.messages("GLOBAL_POSITION_INT")[-1]
    assert globe.relative_alt == pytest.approx(2500, abs=20)


def test_velocity_alone_and_other_frames(client: Client) -> None:
    client.take_off()
    client.go_offboard()
    for _ in range(60):
        client.set_point(math.nan, 0, 0, 0, 1.0, 0, 0, mask=POSITION_VELOCITY_YAW | 7)
        client.run(0.05)
    assert client.px4.commander.airframe.v_enu_m_s == pytest.approx((1.0, 0.0, 0.0), abs=0.02)
    before = client.px4.commander.stream.received
    client.set_point(0, 0, -1, 0, 0, 0, 0, frame=mavlink.MAV_FRAME_BODY_NED)
    assert client.px4.commander.stream.received == before


def test_speed_and_acceleration_are_limited(client: Client) -> None:
    client.take_off()
    client.go_offboard()
    commander, v_before = client.px4.commander, client.px4.commander.airframe.v_enu_m_s
    top_m_s = 0.0
    for _ in range(300):
        client.run(0.01, stream_hz=100, point=(500.0, 0, -1.5, 0, 0, 0, 0))
        v = commander.airframe.v_enu_m_s
        assert math.dist(v, v_before) / 0.01 <= 3.0 + 1e-6
        v_before, top_m_s = v, max(top_m_s, math.hypot(*v))
    assert 4.9 < top_m_s <= 5.0 + 1e-6


@pytest.mark.parametrize(("action", "mode"), [(0, Mode.LAND), (3, Mode.RTL), (4, Mode.LAND), (5, Mode.HOLD)])
def test_a_lost_stream_is_a_failsafe_and_a_resumed_one_is_followed_again(action: int, mode: Mode) -> None:
    client = Client(parameters={"COM_OBL_RC_ACT": action, "MIS_TAKEOFF_ALT": 2.0})
    client.take_off()
    client.go_offboard()
    client.run(0.9)
    assert client.mode() is Mode.OFFBOARD
    client.run(0.2)
    assert client.mode() is mode and client.px4.commander.failsafe
    client.run(1.0)
    assert client.messages("HEARTBEAT")[-1].system_status == mavlink.MAV_STATE_CRITICAL
    client.run(0.05, stream_hz=20)
    assert client.mode() is Mode.OFFBOARD, "PX4 takes a resumed stream up by itself, even out of LAND"


def test_return_goes_home_and_lands_there() -> None:
    client = Client(parameters={"COM_OBL_RC_ACT": 5, "MIS_TAKEOFF_ALT": 2.0})
    client.take_off()
    client.go_offboard()
    client.run(6, stream_hz=20, point=(4.0, 3.0, -2.0, 0, 0, 0, 0))
    client.set_mode(HOLD)
    assert client.set_mode((4, 5)) == [0, 0]
    client.run(40)
    assert client.px4.commander.landed and not client.px4.commander.armed
    assert client.px4.commander.airframe.p_enu_m == pytest.approx((0.0, 0.0, 0.0), abs=0.5)


def test_a_longer_loss_time_is_honoured(client: Client) -> None:
    assert client.px4.order("parameter COM_OF_LOSS_T 3.0") is None
    client.take_off()
    client.go_offboard()
    client.run(2.8)
    assert client.mode() is Mode.OFFBOARD
    client.run(0.3)
    assert client.px4.commander.failsafe


def test_landing_out_of_offboard_returns_to_it_after_disarming(client: Client) -> None:
    client.take_off()
    client.go_offboard()
    client.set_mode(LAND)
    client.run(15)
    assert not client.px4.commander.armed and client.mode() is Mode.OFFBOARD


def test_landing_by_failsafe_also_returns_to_it() -> None:
    client = Client(parameters={"COM_OBL_RC_ACT": 4})
    client.take_off()
    client.go_offboard()
    client.run(18)
    assert not client.px4.commander.armed and client.mode() is Mode.OFFBOARD


def test_hold_on_the_way_down_leaves_offboard_for_good(client: Client) -> None:
    client.take_off()
    client.go_offboard()
    client.set_mode(HOLD)
    client.set_mode(LAND)
    client.run(15, stream_hz=20)
    assert not client.px4.commander.armed and client.mode() is Mode.HOLD


def test_a_pilot_keeps_the_mode_against_the_stream_but_not_against_a_request(client: Client) -> None:
    client.take_off()
    client.go_offboard()
    assert client.px4.order("pilot POSCTL") is None
    client.run(2, stream_hz=20)
    assert client.mode() is Mode.POSCTL
    assert client.messages("HEARTBEAT")[-1].custom_mode == 3 << 16
    assert client.set_mode(OFFBOARD) == [0, 0], "which is why a companion must not ask again"
    assert client.mode() is Mode.OFFBOARD


def test_a_person_flies_with_the_sticks(client: Client) -> None:
    client.run(20.0)
    for velocity, seconds in (("0 0 1", 1.5), ("0.5 0 0", 2.0), ("0 0 0", 2.0)):
        assert client.px4.order(f"sticks {velocity}") is None
        client.run(seconds)
    commander = client.px4.commander
    assert commander.armed and not commander.landed and client.mode() is Mode.POSCTL
    assert commander.airframe.p_enu_m == pytest.approx((1.0, 0.0, 1.5), abs=0.3)
    assert commander.airframe.v_enu_m_s == pytest.approx((0.0, 0.0, 0.0), abs=0.01)


def test_everything_the_companion_sends_is_counted(client: Client) -> None:
    client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
    client.set_mode(HOLD)
    before = dict(client.px4.report(client.now_ns).received)
    client.set_mode(HOLD)
    after = client.px4.report(client.now_ns).received
    assert before["COMMAND_LONG 512"] == 1
    assert {name: count - before.get(name, 0) for name, count in after.items() if count != before.get(name, 0)} == {
        "COMMAND_LONG 176": 1
    }


def test_counters_of_the_stream(client: Client) -> None:
    client.take_off()
    client.run(1, stream_hz=20)
    outside = client.px4.commander.stream.received
    assert 20 <= outside <= 21
    client.set_mode(OFFBOARD)
    client.run(2, stream_hz=20)
    client.run(0.4)
    client.run(2, stream_hz=20)
    client.set_mode(HOLD)
    client.run(1, stream_hz=20)
    report = client.px4.report(client.now_ns)
    assert report.setpoints_in_offboard == pytest.approx(80, abs=2)
    assert report.setpoints_outside == report.setpoints - report.setpoints_in_offboard
    assert report.offboard_s == pytest.approx(4.4, abs=0.03)
    assert report.largest_gap_s == pytest.approx(0.45, abs=0.05)
    assert [mode for _, mode in report.history] == ["HOLD", "TAKEOFF", "HOLD", "OFFBOARD", "HOLD"]
    truth = client.px4.truth(client.now_ns)
    assert (truth.setpoints, truth.mode, truth.armed) == (report.setpoints, "HOLD", True)


def test_mute(client: Client) -> None:
    client.px4.order("mute heartbeats")
    client.run(3)
    assert not client.messages("HEARTBEAT") and client.messages("ATTITUDE")
    client.px4.order("mute everything")
    before = len(client.datagrams)
    client.run(1)
    assert len(client.datagrams) == before
    client.px4.order("mute nothing")
    client.run(1.1)
    assert client.messages("HEARTBEAT")


def test_gusts_are_seeded_and_push_the_airframe() -> None:
    ends = []
    for seed in (1, 1, 2, None):
        client = Client(seed=seed)
        client.take_off()
        client.run(5)
        ends.append(client.px4.commander.airframe.p_enu_m)
    assert ends[0] == ends[1] != ends[2]
    assert 0.001 < math.dist(ends[0], ends[3]) < 0.5


def test_orders_that_make_no_sense_are_named(client: Client) -> None:
    for text in ("", "dance", "pilot NOWHERE", "battery full", "parameter NO_SUCH 1", "parameter COM_OBL_RC_ACT x"):
        error = client.px4.order(text)
        assert error is not None and repr(text) in error
    assert client.px4.order("battery 0.1") is None
    client.run(2.1)
    assert client.messages("BATTERY_STATUS")[-1].battery_remaining == 10
