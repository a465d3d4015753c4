"""What the rules share: what one finds, and how they read a trace."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from companion.core.clock import NS_PER_S
from companion.core.inputs import Event, Wish
from companion.mission.table import State
from companion.sim.px4.commander import Mode
from tests.faults.missions.trace import Asked, Trace, t_ns_of

SLACK_S: Final = 0.06
"""One tick, and what rounding adds."""
STREAMING: Final = frozenset({State.TAKING_OFF, State.ACQUIRING, State.APPROACHING, State.HOLDING})
Found = Iterator[tuple[int, str]]
"""When a promise was broken, and by what."""


def since_start_s(trace: Trace, t_ns: int) -> float:
    return (t_ns - t_ns_of(trace.entries[0])) / NS_PER_S


def is_engaged(entry: object) -> bool:
    """Whether a person has taken the vehicle by this."""
    return isinstance(entry, Wish) and entry.wish is Event.ENGAGE and not entry.refusal


def takes_vehicle(entry: Asked) -> bool:
    return entry.what in ("arm", "takeoff") or entry.wanted is Mode.OFFBOARD
