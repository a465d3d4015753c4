"""What PX4 1.16.1 tells of its arming checks, as a real one's messages have it.

One bit of SYS_STATUS's health, which is never among what is present or enabled, says whether the mode of now can arm.
Why not is told by EVENT messages and by no STATUSTEXT: a report is a summary, one event for each check that found
something, and another summary. It comes when something changes, no sooner than 2 s after the last, and when it is asked
for.
"""

from __future__ import annotations

import struct
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.core.clock import NS_PER_S
from companion.sim.px4.clocks import PowerUpClock
from companion.sim.px4.commander import Commander

PREARM_CHECK: Final = 1 << 28
CHECKS: Final = {
    "high_accel_bias": 20390844, "accel_missing": 25005055, "usb_connected": 24439368, "global_pos": 26788467,
}  # fmt: skip
"""Checks that a test may let fail, by the ids of their events."""
_SUMMARY, _HEALTH_SUMMARY, _NO_OFFBOARD_SIGNAL, _NO_STICKS = 27825120, 18691879, 19865031, 17231145
_OFFBOARD_ONLY, _EVERY_MODE = 1 << 14, 0xFFFFFFFF
_ERROR, _WARNING, _PROTOCOL = 0x33, 0x44, 0x88
_EVERY_NS: Final = 2 * NS_PER_S
_EVENT, _CRC_EXTRA = 410, 160  # not in pymavlink's dialects
_FIELDS: Final = struct.Struct("<IIHBBB40s")


def prearm_health(commander: Commander) -> int:
    """The bit, or 0."""
    return PREARM_CHECK if commander.armed or commander.can_arm else 0


def report(commander: Commander) -> list[tuple[int, int, bytes]]:
    """A whole report: number, levels and arguments of each event."""
    found = [(CHECKS[name], _ERROR, struct.pack("<IB", _EVERY_MODE, 20)) for name in commander.failing_checks]
    return [
        (_SUMMARY, _PROTOCOL, b""),
        (_NO_OFFBOARD_SIGNAL, _ERROR, struct.pack("<IB", _OFFBOARD_ONLY, 20)),
        (_NO_STICKS, _WARNING, struct.pack("<IB", _EVERY_MODE, 7)),
        *found,
        (_HEALTH_SUMMARY, _PROTOCOL, b""),
    ]


class ArmingReports:
    """Writes its frames to the file of `mav`."""

    def __init__(self, commander: Commander, clock: PowerUpClock, mav: Any) -> None:
        self._commander = commander
        self._clock = clock
        self._mav = mav
        self._sequence = 0
        self._reported: tuple[object, ...] = ()
        self._next_ns = 0

    def boot(self) -> None:
        self._sequence, self._reported, self._next_ns = 0, (), 0

    def send_due(self, now_ns: int) -> None:
        if now_ns >= self._next_ns and self._found() != self._reported:
            self.send(now_ns)

    def send(self, now_ns: int) -> None:
        self._reported, self._next_ns = self._found(), now_ns + _EVERY_NS
        for number, levels, arguments in report(self._commander):
            self._event(number, levels, arguments, now_ns)

    def _found(self) -> tuple[object, ...]:
        return (self._commander.failing_checks, self._commander.can_arm)

    def _event(self, number: int, levels: int, arguments: bytes, now_ns: int) -> None:
        boot_ms = self._clock.ns(now_ns) // 1_000_000 & 0xFFFFFFFF
        payload = _FIELDS.pack(number, boot_ms, self._sequence & 0xFFFF, 0, 0, levels, arguments)
        message = mavlink.MAVLink_message(_EVENT, "EVENT")
        self._mav.file.write(message._pack(self._mav, _CRC_EXTRA, payload))
        self._mav.seq = (self._mav.seq + 1) % 256
        self._sequence += 1
