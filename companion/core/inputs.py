"""Inputs that are no bytes of a device, as the log holds them: a tick, a wish, an outcome, an answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum


@dataclass(frozen=True, slots=True)
class Tick:
    """The control loop ran."""

    t_mono_ns: int
    slept_s: float = 0.0
    """So long the host was suspended since the tick before, which the monotonic clock does not show."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """A person asked for something; `refusal` is the answer, empty when it was granted. What an engagement asks of the
    autopilot takes a while: this is when it was answered."""

    t_mono_ns: int
    wish: Event
    refusal: str
    by_switch: bool = False
    """By the switch on the transmitter, not by a command."""
    vehicle: str = ""
    """Which one it was about: its system id, what it says it is, its firmware."""
    target: int | None = None
    """Id of the robot that was named to fly to; None where none was."""


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """A command to the autopilot has ended: what the mission is told (None for nothing), and why it failed."""

    t_mono_ns: int
    event: Event | None
    error: str


@dataclass(frozen=True, slots=True)
class BookState:
    """How far each peer (by its id) had got when the service began."""

    t_mono_ns: int
    reached: Mapping[str, Reached]


@dataclass(frozen=True, slots=True)
class WorkerState:
    """The AOA worker began or ceased to wait for apertures."""

    t_mono_ns: int
    is_ready: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """The answer to aperture `id` arrived. `failure` says what happened to the worker; empty when it computed."""

    t_mono_ns: int
    id: int
    peer: int
    compute_s: float
    failure: str


@dataclass(frozen=True, slots=True)
class Reached:
    """How far a sender got: its newest boot id, and a counter that none accepted of that boot exceeds."""

    boot_id: int
    ceiling: int


class Event(StrEnum):
    """In order of severity, worst first: of several in one tick only the worst is acted upon."""

    TASK_FAILED = "task_failed"
    MODE_LOST = "mode_lost"
    """The pilot or a failsafe took a mode we did not ask for."""
    STALLED = "stalled"
    """The set point stream stood still so long that the autopilot may have acted by itself."""
    LINK_LOST = "link_lost"
    """No word of the autopilot's mode."""
    ABORT = "abort"
    POSE_LOST = "pose_lost"
    """The tracker shows that it has failed, or has been silent for longer than it ever needs to come back."""
    BATTERY_LOW = "battery_low"
    BATTERY_UNKNOWN = "battery_unknown"
    """A battery that was known tells nothing any more."""
    OFFBOARD_REFUSED = "offboard_refused"
    TAKEOFF_FAILED = "takeoff_failed"
    PREFLIGHT_FAILED = "preflight_failed"
    LANDED = "landed"
    TIMEOUT = "timeout"
    """The state has lasted longer than its limit."""
    POSE_STALE = "pose_stale"
    """No poses for longer than an aperture survives."""
    BEARING_STALE = "bearing_stale"
    """The target is silent, or leg after leg gave no bearing."""
    TARGET_REACHED = "target_reached"
    PREFLIGHT_PASSED = "preflight_passed"
    AIRBORNE = "airborne"
    OFFBOARD_CONFIRMED = "offboard_confirmed"
    BEARING_BACK = "bearing_back"
    """Packets and datagrams of the target come again, or are worth another try."""
    BEARING = "bearing"
    """A new reliable bearing."""
    RETARGET = "retarget"
    """A person named another robot to fly to while the vehicle flies."""
    ENGAGE = "engage"


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """One look, recorded with the event that looked."""

    t_mono_ns: int
    autopilot_problem: str
    """Why there is no connection to the autopilot; empty while there is one."""
    parameters_checked: bool
    """The autopilot's parameters were found as required a moment ago."""
    bad_signatures: int
    """Datagrams in the target's name with a wrong signature; anybody can send them, so they are not recorded."""
    recorder_failed: bool
    free_mib: float
    """On the log's disk."""
    network_problem: str = ""
    """Why robots cannot be heard or reached."""
