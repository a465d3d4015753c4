"""Whether PX4's own arming checks pass, and why they do not.

SYS_STATUS has a bit of health for it. PX4 1.14 to 1.17 never set that bit among what is present or enabled (seen on
1.16.1; older ones do), so its absence there says nothing. Decided therefore:

- the bit in health: passed;
- no bit, or no SYS_STATUS for 3 s: not passed. What is unknown is not good;
- no bit anywhere, ever, from a firmware that says it is older than 1.14 (0.0.0 says nothing: built without its
  version): not known (None), and nothing is refused for
  it. PX4 itself still refuses to arm.

Reasons come by EVENT (see `arming_events`), from older firmware by STATUSTEXT, which PX4 1.16 sends to a ground station
only.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from companion.autopilot import arming_events
from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode

_PREARM_CHECK: Final = 1 << 28
_FRESH_NS: Final = 3 * NS_PER_S
_SHOWN: Final = 3
_KEPT: Final = 20
_ERROR: Final = 3
_TOLD_SINCE: Final = (1, 14)
_NO_VERSION: Final = (0, 0)
_ANY: Final = 0xFFFFFFFF
_TEXT: Final = "preflight fail"


@dataclass(frozen=True, slots=True)
class _Found:
    """One check that found something."""

    modes: int
    severity: int
    words: str


class ArmingChecks:
    """Fed with messages; asked by `passed` and `reasons`."""

    def __init__(self) -> None:
        self._told_ns: int | None = None
        self._passed = False
        self._has_bit = False
        self._found: list[_Found] = []
        self._is_report = False

    def status(self, present: int, enabled: int, health: int, now_ns: int) -> None:
        """The sensor masks of a SYS_STATUS."""
        self._told_ns = now_ns
        self._has_bit = self._has_bit or bool((present | enabled | health) & _PREARM_CHECK)
        self._passed = bool(health & _PREARM_CHECK)
        if self._passed:
            self._found.clear()

    def event(self, number: int, severity: int, modes: int) -> None:
        """An EVENT; `modes` is the first of its arguments."""
        if number in (arming_events.BEGIN, arming_events.END):
            self._is_report = number == arming_events.BEGIN
            if self._is_report:
                self._found.clear()
        elif self._is_report:
            self._keep(_Found(modes, severity, arming_events.words(number)))

    def text(self, severity: int, text: str) -> None:
        """A STATUSTEXT: kept when it is of a check."""
        if text.lower().startswith(_TEXT):
            self._keep(_Found(_ANY, severity, text.partition(":")[2].strip() or text))

    def passed(self, firmware: str, now_ns: int) -> bool | None:
        """None where the firmware does not tell."""
        if self._told_ns is None or now_ns - self._told_ns > _FRESH_NS:
            return False
        if not self._has_bit and firmware and _NO_VERSION < _version(firmware) < _TOLD_SINCE:
            return None
        return self._passed

    def reasons(self, mode: FlightMode | None, now_ns: int) -> tuple[str, ...]:
        """Why they do not pass in `mode`, as far as it was told: the errors, or without any whatever was found."""
        if self._told_ns is None or now_ns - self._told_ns > _FRESH_NS:
            return ("it tells nothing of them (SYS_STATUS)",)
        found = [one for one in self._found if arming_events.concerns(one.modes, mode)]
        errors = [one for one in found if one.severity <= _ERROR]
        return tuple(one.words for one in (errors or found)[-_SHOWN:])

    def _keep(self, found: _Found) -> None:
        """The newest of each."""
        others = [one for one in self._found if one.words != found.words]
        self._found = [*others[1 - _KEPT :], found]


def _version(firmware: str) -> tuple[int, ...]:
    return tuple(map(int, firmware.split(".")[:2]))
