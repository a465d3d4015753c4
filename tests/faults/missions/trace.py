"""What happened in one mission, in order of time: what promises are checked against."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from companion.core.inputs import Wish
from companion.core.messages import Setpoint, Vector3, VehicleState
from companion.flight.records import MissionStep
from companion.mission.table import State
from companion.sim.px4.commander import Mode
from tests.faults.missions.scenario import Fault, Scenario


@dataclass(
    slots=True, kw_only=True
)  # thousands of them, by nobody changed: what is frozen takes five times as long to make
class Ticked:
    """The loop ticked: what it was told of the vehicle then, and what really was."""

    t_ns: int
    told: VehicleState
    state: State
    really: Mode
    intention: Mode
    armed: bool
    pose_silent_s: float
    """Since the tracker last sent a pose that can be used."""
    packet_s: float
    datagram_s: float
    ready: tuple[bool, ...]
    """Worker, recorder, clock relation, estimator, arming checks: whether each is as it should be."""


@dataclass(slots=True, kw_only=True)
class Sent:
    """A set point left, whether it arrived or not."""

    t_ns: int
    setpoint: Setpoint
    told: VehicleState
    state: State
    really: Mode
    places: tuple[Vector3, ...]
    """Where robots were known to be."""
    ground_m: float = 0.0
    """Up from which heights are counted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """A command left: arming, takeoff or a mode (`wanted`)."""

    t_ns: int
    what: str
    wanted: Mode | None
    told: VehicleState
    state: State


@dataclass(frozen=True, slots=True)
class Moded:
    """The mode that flies changed, really."""

    t_ns: int
    mode: Mode
    armed: bool


@dataclass(frozen=True, slots=True)
class Switched:
    """The RC switch, as it was told; `up` is None without RC."""

    t_ns: int
    up: bool | None


@dataclass(frozen=True, slots=True)
class Served:
    """The service began, or was told to end, or was killed, or has ended."""

    t_ns: int
    what: str
    was_flying: bool = False
    told: VehicleState | None = None


@dataclass(frozen=True, slots=True)
class Failed:
    """The flight raised something: it never should."""

    t_ns: int
    error: str


@dataclass(frozen=True, slots=True)
class Faulted:
    t_ns: int
    fault: Fault
    begins: bool


Entry = Ticked | Sent | Asked | Moded | Switched | Served | Failed | Faulted | MissionStep | Wish


@dataclass(slots=True)
class Trace:
    scenario: Scenario
    entries: list[Entry] = field(default_factory=list)
    quiet_ns: int = 0
    """Until when the link was last disturbed."""

    def of(self, *kinds: type[Any]) -> list[Any]:
        return [entry for entry in self.entries if isinstance(entry, kinds)]


def t_ns_of(entry: Entry) -> int:
    return entry.t_mono_ns if isinstance(entry, MissionStep | Wish) else entry.t_ns


LINK_FAULTS: Final = frozenset({"mute", "deaf", "closed", "offboard", "commands", "reboot", "pause", "estimator"})
"""While one of these lasts, what is asked for may not arrive or not be granted."""
