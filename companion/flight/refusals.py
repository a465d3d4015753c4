"""What the gate says to the stream: recorded whenever it changes, and weighed: a refusal that is new costs a leg."""

from __future__ import annotations

from typing import Final

from companion.core.clock import age_s
from companion.core.recorder import Recorder
from companion.core.streams import GATE
from companion.flight.records import GateReport
from companion.safety.gate import Reason

_AGAIN_S: Final = 5.0


class GateRefusals:
    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._reasons: tuple[Reason, ...] = ()
        self._counted_ns: int | None = None

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Why the newest set point was refused; none when it passed."""
        return self._reasons

    def note(self, reasons: tuple[Reason, ...], now_ns: int, excused: bool) -> bool:
        """Whether the leg is to be given up: the gate has begun to refuse, or has refused for `_AGAIN_S` more.
        `excused`, what it says is not the path's fault."""
        is_new = not self._reasons or age_s(self._counted_ns, now_ns) >= _AGAIN_S
        counts = bool(reasons) and is_new and not excused
        if counts:
            self._counted_ns = now_ns
        if reasons != self._reasons:
            self._reasons = reasons
            self._recorder.record(GATE, now_ns, GateReport(now_ns, reasons))
        return counts
