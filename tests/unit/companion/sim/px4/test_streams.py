"""What the mock sends, how often, and what changes that."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.sim.px4.commander import Mode
from tests.unit.companion.sim.px4.client import Client


@pytest.fixture
def client() -> Client:
    return Client(parameters={"COM_OBL_RC_ACT": 5, "MIS_TAKEOFF_ALT": 1.5})


def test_streams_keep_their_rates(client: Client) -> None:
    client.run(10)
    for name, low, high in [
        ("HEARTBEAT", 10, 11),
        ("LOCAL_POSITION_NED", 300, 303),
        ("ATTITUDE", 499, 502),
        ("EXTENDED_SYS_STATE", 50, 51),
        ("SYS_STATUS", 50, 51),
        ("BATTERY_STATUS", 5, 6),
        ("CURRENT_MODE", 5, 6),
        ("HOME_POSITION", 5, 6),
    ]:
        assert low <= len(client.messages(name)) <= high, name


def test_message_interval_can_be_set_but_not_the_heartbeats(client: Client) -> None:
    assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 20_000) == [
        0
    ]
    assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_CURRENT_MODE, 50_000) == [0]
    assert client.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_HEARTBEAT, 100_000) == [4]
    client.run(2)
    assert 100 <= len(client.messages("LOCAL_POSITION_NED")) <= 102
    assert len(client.messages("CURRENT_MODE")) <= 6, "only after an update of the vehicle's status, 2 Hz at rest"
    before = len(client.messages("CURRENT_MODE"))
    client.px4.commander.pilot_mode(Mode.POSCTL)
    client.run(0.06)
    assert client.messages("CURRENT_MODE")[before].custom_mode == 3 << 16
