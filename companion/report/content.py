"""What a report shows of a flight, gathered in one pass over its log."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt
from foxglove_schemas_protobuf.Log_pb2 import Log

from companion.config.schema import Config
from companion.core.streams import (
    BEARING,
    COMMAND,
    CSI,
    GATE,
    HEALTH,
    LOG,
    MISSION,
    NEIGHBOUR,
    POSE_IN,
    PROFILE,
    SETPOINT,
    TARGET,
    VEHICLE,
    WISH,
)
from companion.flight.records import SERVICE_ENDS
from companion.log.foxglove import power_of
from companion.log.reader import LoggedMessage, Progress, Session
from companion.log.records import LoggedIteration, TruthTrack
from companion.log.times import main_span_ns, per_second
from companion.log.truths import truth_of
from companion.report.timeline import Timeline

Floats = npt.NDArray[np.float64]
_WARNING: Final = Log.WARNING
_DISTANCES: Final = 600
_COUNTED: Final = (CSI, POSE_IN, NEIGHBOUR, SETPOINT)


@dataclass(frozen=True, slots=True)
class EventLine:
    """Something that happened at one moment."""

    t_s: float
    kind: str
    text: str


@dataclass(slots=True, kw_only=True)
class FlightContent:
    """Times are seconds since the first message; places ENU in the autopilot's local frame."""

    session: Session
    config: Config
    start_ns: int = 0
    duration_s: float = 0.0
    is_whole: bool = True
    left_out: int = 0
    """Messages of another time altogether: of a clock that was not set."""
    iterations: list[LoggedIteration] = field(default_factory=list)
    profiles: dict[int, npt.NDArray[np.float32]] = field(default_factory=dict)
    """By the number of the iteration."""
    truth: TruthTrack = field(default_factory=lambda: TruthTrack(()))
    vehicle_t_s: list[float] = field(default_factory=list)
    vehicle_m: list[tuple[float, float, float]] = field(default_factory=list)
    modes: list[tuple[float, str]] = field(default_factory=list)
    arrivals_s: dict[str, list[float]] = field(default_factory=dict)
    """Of each message, by topic."""
    health: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    events: list[EventLine] = field(default_factory=list)
    states: list[tuple[float, str]] = field(default_factory=list)
    steps: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    """The mission's transitions."""
    targets: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    """What each bearing made of the target that is flown to."""
    aims: list[tuple[float, int]] = field(default_factory=list)
    """From when on which robot was flown to, where one was named; before, it is the configuration's."""
    timeline: Timeline | None = None

    def seconds(self, t_mono_ns: int) -> float:
        """Since the first message, of a monotonic time."""
        return (t_mono_ns + self.session.wall_minus_mono_ns - self.start_ns) / 1e9

    def target_at(self, t_s: float) -> int:
        """Id of the robot that was flown to."""
        return next((peer for since_s, peer in reversed(self.aims) if since_s <= t_s), self.config.target)

    def peer_name(self, peer: int) -> str:
        return next((one.name for one in self.config.peers if one.id == peer), str(peer))

    def true_bearing(self, iteration: LoggedIteration) -> tuple[float, float] | None:
        """Azimuth and polar angle [rad] at the iteration's reference time."""
        return self.truth.bearing(iteration.reference_ns, self.peer_name(iteration.peer))

    def true_distances(self) -> list[tuple[float, float]]:
        """(seconds, metres) between our antenna and the target's, where the truth knows; a few a second."""
        apart_m = {
            name: np.linalg.norm(places_m - self.truth.antenna_m, axis=1).tolist()
            for name, places_m in self.truth.peers_m.items()
        }
        times_s = [self.seconds(t_ns) for t_ns in self.truth.t_ns.tolist()]
        names = [self.peer_name(self.target_at(t_s)) for t_s in times_s]
        rows = [
            (t_s, apart_m[name][k]) for k, (t_s, name) in enumerate(zip(times_s, names, strict=True)) if name in apart_m
        ]
        seen = [(t_s, d) for t_s, d in rows if 0 <= t_s <= self.duration_s and np.isfinite(d)]
        return seen[:: max(1, len(seen) // _DISTANCES)]

    def rate(self, topic: str) -> tuple[Floats, Floats]:
        """Seconds since the start and messages a second in each; what is left at the end is no whole second."""
        return per_second(self.arrivals_s.get(topic, []), self.duration_s)


def gather(session: Session, progress: Progress | None = None) -> FlightContent:
    """Raises CompanionError for an unreadable log."""
    times_ns = array("Q")
    content = _gather(session, progress, None, times_ns)
    span = main_span_ns(times_ns)
    return content if span is None else _gather(session, progress, span, array("Q"))


def _gather(
    session: Session, progress: Progress | None, span_ns: tuple[int, int] | None, times_ns: array[int]
) -> FlightContent:
    """Of the messages within a span, and all their times."""
    content = FlightContent(session=session, config=session.config())
    content.timeline = Timeline(content.config, session.paths[0].name, session.wall_minus_mono_ns)
    last_bearing: int | None = None
    for message in session.messages(None, progress, lambda path: setattr(content, "is_whole", False)):
        times_ns.append(message.log_time_ns)
        if span_ns is not None and not span_ns[0] <= message.log_time_ns <= span_ns[1]:
            content.left_out += 1
            continue
        content.start_ns = content.start_ns or message.log_time_ns
        t_s = (message.log_time_ns - content.start_ns) / 1e9
        content.duration_s = max(content.duration_s, t_s)
        content.timeline.take(message)
        if message.topic in {stream.topic for stream in _COUNTED}:
            content.arrivals_s.setdefault(message.topic, []).append(t_s)
        if message.topic == BEARING.topic:
            content.iterations.append(msgspec.json.decode(message.data, type=LoggedIteration))
            last_bearing = content.iterations[-1].number
        elif message.topic == PROFILE.topic and last_bearing is not None:
            content.profiles[last_bearing] = power_of(message.data)
        elif message.topic == VEHICLE.topic:
            _take_vehicle(content, t_s, msgspec.json.decode(message.data))
        elif message.topic == TARGET.topic:
            report = msgspec.json.decode(message.data)
            content.targets += [(t_s, report)] if report["peer"] == content.target_at(t_s) else []
        elif message.topic == HEALTH.topic:
            content.health.append((t_s, msgspec.json.decode(message.data)))
        else:
            content.events += _events(content, t_s, message)
    content.truth = truth_of(session)
    return content


def _take_vehicle(content: FlightContent, t_s: float, state: dict[str, Any]) -> None:
    if state["p_local_enu_m"] is not None:
        content.vehicle_t_s.append(t_s)
        x, y, z = state["p_local_enu_m"]
        content.vehicle_m.append((x, y, z))
    mode = state["mode"] or "unknown"
    if not content.modes or content.modes[-1][1] != mode:
        content.modes.append((t_s, mode))
        content.events.append(EventLine(t_s, "vehicle", f"mode {mode}"))


def _events(content: FlightContent, t_s: float, message: LoggedMessage) -> Iterator[EventLine]:
    if message.topic == LOG.topic:
        line = Log.FromString(message.data)
        if line.level >= _WARNING:
            yield EventLine(t_s, "log", f"{line.name}: {line.message}")
        return
    if message.topic not in {stream.topic for stream in (MISSION, GATE, WISH, COMMAND)}:
        return
    values = msgspec.json.decode(message.data)
    if message.topic == MISSION.topic:
        content.steps.append((t_s, values))
        if values["reason"] != SERVICE_ENDS:
            content.states.append((t_s, values["next_state"]))
        why = "" if values["reason"] in ("", values["event"]) else f" ({values['reason']})"
        yield EventLine(t_s, "mission", f"{values['state']} -> {values['next_state']} on {values['event']}{why}")
    elif message.topic == GATE.topic:
        yield EventLine(
            t_s, "gate", "refuses: " + "; ".join(values["reasons"]) if values["reasons"] else "passes again"
        )
    elif message.topic == WISH.topic:
        named = values.get("target")
        if named is not None and not values["refusal"]:
            content.aims.append((t_s, named))
        to = "" if named is None else f" to {content.peer_name(named)}"
        refused = f", refused: {values['refusal']}" if values["refusal"] else ""
        yield EventLine(t_s, "wish", f"{values['wish']}{to}{refused}")
    else:
        yield EventLine(t_s, "command", values["error"] or f"done: {values['event'] or 'nothing to report'}")
