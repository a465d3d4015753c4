"""What docs/safety.md promises, as rules over the trace of one mission. Each names what broke it, and when.

Limits are written here anew, not taken from the code that keeps them. `told` is what telemetry had said by then, which
is all the companion can go by; `really` is the mock autopilot's own state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from tests.faults.missions.promises.engaging import (
    abort_ends_it,
    battery_is_known,
    latched_until_engaged,
    person_engages,
    preflight_holds,
    switch_seen_down,
)
from tests.faults.missions.promises.modes import asked_for_3_s, left_in_hold, lost_mode_is_left, never_taken_back
from tests.faults.missions.promises.rule import Found, since_start_s
from tests.faults.missions.promises.service import nothing_raises, restart_is_idle
from tests.faults.missions.promises.stream import (
    faults_end_the_stream,
    fresh,
    observing_is_silent,
    one_per_tick,
    only_in_our_modes,
    still_stream_is_over,
    within_limits,
)
from tests.faults.missions.trace import Trace

PROMISES: Final[tuple[Callable[[Trace], Found], ...]] = (
    one_per_tick, still_stream_is_over, lost_mode_is_left, only_in_our_modes, never_taken_back, within_limits, fresh,
    faults_end_the_stream, person_engages, preflight_holds, battery_is_known, abort_ends_it, asked_for_3_s,
    restart_is_idle, left_in_hold, observing_is_silent, switch_seen_down, latched_until_engaged, nothing_raises,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Violation:
    promise: str
    t_s: float
    """Since the mission began."""
    what: str


def violations(trace: Trace) -> list[Violation]:
    """The first of each promise."""
    found = []
    for promise in PROMISES:
        first = next(iter(promise(trace)), None)
        if first is not None:
            found.append(Violation(promise.__name__, round(since_start_s(trace, first[0]), 3), first[1]))
    return found
