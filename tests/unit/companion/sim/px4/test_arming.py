"""The mock's arming checks as a real PX4 1.16.1 tells of them."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from tests.unit.companion.sim.px4.client import LAND, Client

_BIT = mavlink.MAV_SYS_STATUS_PREARM_CHECK
_SUMMARY, _HEALTH_SUMMARY, _OFFBOARD_SIGNAL, _ACCEL_BIAS = 27825120, 18691879, 19865031, 20390844


def _masks(message: Any) -> tuple[bool, bool, bool]:
    parts = ("present", "enabled", "health")
    present, enabled, health = (bool(getattr(message, f"onboard_control_sensors_{part}") & _BIT) for part in parts)
    return present, enabled, health


def _events(client: Client, since: int = 0) -> list[tuple[int, int, int]]:
    """(number, external level, modes) of each."""
    frames = [bytes(m.data)[10:-2].ljust(53, b"\0") for m in client.decoded(since) if m.get_type() == "UNKNOWN_410"]
    return [(int.from_bytes(f[:4], "little"), f[12] & 15, int.from_bytes(f[13:17], "little")) for f in frames]


def test_the_bit_is_one_of_health_and_never_present_or_enabled() -> None:
    client = Client()
    client.run(1.0)
    assert {_masks(m) for m in client.messages("SYS_STATUS")} == {(False, False, True)}
    client.order("checks fail high_accel_bias")
    client.run(1.0)
    assert _masks(client.messages("SYS_STATUS")[-1]) == (False, False, False)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [mavlink.MAV_RESULT_TEMPORARILY_REJECTED]
    client.order("checks pass")
    client.run(1.0)
    assert _masks(client.messages("SYS_STATUS")[-1]) == (False, False, True)
    assert client.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [mavlink.MAV_RESULT_ACCEPTED]


def test_it_is_of_the_mode_it_is_in_and_always_so_when_armed() -> None:
    client = Client()
    client.run(1.0)
    client.set_mode(LAND)
    client.run(0.5)
    assert _masks(client.messages("SYS_STATUS")[-1])[2] is False, "PX4 does not arm in land"
    armed = Client()
    armed.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    armed.order("checks fail accel_missing")
    armed.run(0.5)
    assert _masks(armed.messages("SYS_STATUS")[-1])[2] is True


def test_a_report_is_between_two_summaries_on_each_change_and_when_it_is_asked_for() -> None:
    client = Client()
    client.run(5.0)
    first = _events(client)
    assert first[0][0] == _SUMMARY and first[-1][0] == _HEALTH_SUMMARY and len(first) == 4, "once"
    assert (_OFFBOARD_SIGNAL, 3, 1 << 14) in first
    before = len(client.datagrams)
    client.order("checks fail high_accel_bias")
    client.run(5.0)
    assert [number for number, _, _ in _events(client, before)].count(_ACCEL_BIAS) == 1
    before = len(client.datagrams)
    assert client.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == [mavlink.MAV_RESULT_ACCEPTED]
    assert (_ACCEL_BIAS, 3, 0xFFFFFFFF) in _events(client, before)
    assert not client.messages("STATUSTEXT")
