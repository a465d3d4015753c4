"""The mock's link as PX4's: its own clock, identity, batteries, types of parameters, restarts and other vehicles."""

from __future__ import annotations

import struct

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.px4.commander import Mode
from tests.unit.companion.sim.px4.client import Client


def test_its_clock_begins_at_power_up_and_goes_at_its_own_rate() -> None:
    client = Client(clock_rate=0.985)
    client.run(0.1)
    first = client.messages("LOCAL_POSITION_NED")[-1].time_boot_ms
    assert first < 60_000, "nothing like the host's monotonic clock"
    client.run(100)
    assert client.messages("LOCAL_POSITION_NED")[-1].time_boot_ms - first == pytest.approx(98_500, abs=60)
    requests = [m for m in client.messages("TIMESYNC") if m.tc1 == 0]
    assert requests[-1].ts1 // 1_000_000 == pytest.approx(client.messages("ATTITUDE")[-1].time_boot_ms, abs=110)


def test_the_first_heartbeat_comes_after_other_messages() -> None:
    client = Client()
    client.run(0.4)
    assert client.messages("LOCAL_POSITION_NED") and not client.messages("HEARTBEAT")
    client.run(0.2)
    assert client.messages("HEARTBEAT")


@pytest.mark.parametrize(("kind", "number"), [("px4", 12), ("ardupilot", 3)])
def test_it_says_what_it_is(kind: str, number: int) -> None:
    client = Client(kind=kind, system_id=7)
    client.run(1)
    heartbeat = client.messages("HEARTBEAT")[-1]
    assert (heartbeat.autopilot, heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (number, 7, 1)
    assert client.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == []
    client.send(mavlink.MAVLink_command_long_message(7, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0))
    assert client.messages("AUTOPILOT_VERSION")[-1].flight_sw_version == 0x011001FF


def test_two_batteries_each_told_with_its_id() -> None:
    client = Client()
    client.order("battery 0 0.05")
    client.order("battery 1 0.95")
    client.run(2.1)
    assert {m.id: m.battery_remaining for m in client.messages("BATTERY_STATUS")[-2:]} == {0: 5, 1: 95}
    client.order("battery 1 unknown")
    client.run(2.1)
    assert {m.id: m.battery_remaining for m in client.messages("BATTERY_STATUS")[-2:]} == {0: 5, 1: -1}
    client.order("battery 0 silent")
    before = len(client.messages("BATTERY_STATUS"))
    client.run(4.1)
    assert {m.id for m in client.messages("BATTERY_STATUS")[before:]} == {1}


def test_a_parameter_of_the_wrong_type_is_ignored_without_an_answer() -> None:
    client = Client()
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", 4.0, mavlink.MAV_PARAM_TYPE_REAL32))
    four = struct.unpack("<f", struct.pack("<i", 4))[0]
    client.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", four, mavlink.MAV_PARAM_TYPE_INT32))
    assert not client.messages("PARAM_VALUE")
    assert client.px4.commander.parameters["COM_OBL_RC_ACT"] == 0
    assert client.px4.commander.parameters["COM_OF_LOSS_T"] == 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("RTL_RETURN_ALT", 30.0), ("NAV_RCL_ACT", 2), ("MIS_TAKEOFF_ALT", 2.5), ("NAV_MC_ALT_RAD", 0.8),
        ("EKF2_EV_CTRL", 0), ("EKF2_HGT_REF", 1), ("EKF2_GPS_CTRL", 7), ("COM_OBL_RC_ACT", 0), ("COM_RC_OVERRIDE", 1),
        ("COM_OF_LOSS_T", 1.0), ("GF_ACTION", 2), ("GF_MAX_VER_DIST", 0.0), ("SYS_HAS_GPS", 1),
        ("COM_TAKEOFF_ACT", 0),
    ],
)  # fmt: skip
def test_defaults_are_px4s(name: str, value: float) -> None:
    found = Client().px4.commander.parameters[name]
    assert found == value and type(found) is type(value)


def test_a_restart_forgets_intervals_and_begins_its_clock_anew() -> None:
    client = Client()
    client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 10_000)
    client.set_mode((6, 0))
    client.run(30)
    client.order("reboot 3")
    before = len(client.datagrams)
    client.run(2.9)
    assert len(client.datagrams) == before, "it says nothing while it starts"
    assert client.command(400, 1) == []
    client.run(5.1)
    positions = client.messages("LOCAL_POSITION_NED", before)
    assert len(positions) == pytest.approx(150, abs=3), "30 a second again"
    assert positions[0].time_boot_ms < 100 and client.mode() is Mode.HOLD
    assert client.px4.link.companion_clock.samples == 0


def test_another_vehicle_on_the_link_takes_what_is_addressed_to_it_alone() -> None:
    client = Client()
    client.order("stranger 2")
    client.run(2)
    assert {m.get_srcSystem() for m in client.messages("HEARTBEAT")} == {1, 2}
    client.send(mavlink.MAVLink_command_long_message(2, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert client.px4.strangers[0].commander.armed and not client.px4.commander.armed
    client.order("vanish")
    before = len(client.datagrams)
    client.run(2)
    assert {m.get_srcSystem() for m in client.decoded(before)} == {2}
