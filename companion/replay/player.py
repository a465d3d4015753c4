"""Drives the handlers of the service with the events of a log, in their order and at their times."""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec

from companion.autopilot.port import Autopilot
from companion.camera import sighting
from companion.config.schema import Config
from companion.core.clock import Clock
from companion.core.event_clock import EventClock
from companion.core.inputs import Answer, BookState, CommandOutcome, Surroundings, Tick, Wish, WorkerState
from companion.core.messages import VehicleState, pose_of
from companion.core.streams import (
    ANSWER,
    APERTURE,
    BOOK,
    COMMAND,
    CSI,
    END,
    NEIGHBOUR,
    POSE_IN,
    PROFILE,
    SECOND,
    STREAMS,
    SURROUNDINGS,
    TAG,
    TICK,
    VEHICLE,
    WISH,
    WORKER,
    Part,
    Stream,
)
from companion.errors import CompanionError
from companion.flight.commands import FlightCommands, Report
from companion.log.encoding import encoded
from companion.log.reader import LoggedMessage, Session
from companion.replay.ahead import ReadAhead
from companion.replay.datagrams import resigned
from companion.replay.recorded import (
    REPLAY_KEY,
    RecordedAutopilot,
    RecordedCommands,
    RecordedInputs,
    RecordedWorker,
    ReplayClock,
)
from companion.roles.uav import Uav
from companion.sensing.worker_wire import AoaResult

INPUT_TOPICS: Final = frozenset(stream.topic for stream in STREAMS if stream.part is Part.INPUT)
DECISION_TOPICS: Final = frozenset(stream.topic for stream in STREAMS if stream.part is Part.DECISION)
_USUAL_LATENCY_NS: Final = 150_000_000


@dataclass(frozen=True, slots=True)
class InputEvent:
    """All that was given to the service in one event, by topic; `t_ns` is the service's monotonic time."""

    number: int
    t_ns: int
    inputs: dict[str, list[bytes]]
    own_t_ns: dict[str, list[int]]
    """When each of them came by its own stamp: before the event, if it waited to be read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Decided:
    """One message of the service, as it would stand in a log."""

    stream: Stream
    t_ns: int
    own_t_ns: int
    event: int
    source: Any
    """What its schema is made from."""
    data: bytes


@dataclass(slots=True)
class ReplayLog:
    """A `Recorder` that keeps what is decided, with the profiles, and passes over inputs, reports and other views."""

    clock: EventClock
    wall_minus_mono_ns: int
    decided: list[Decided] = field(default_factory=list)
    also: Callable[[Stream, int, Any], None] | None = None
    """Told of everything, as it is recorded: what shows the replay."""

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        if self.also is not None:
            self.also(stream, t_mono_ns, message)
        if stream.part is Part.DECISION or stream is PROFILE:
            data, source = encoded(stream, t_mono_ns + self.wall_minus_mono_ns, message)
            entry = Decided(
                stream=stream,
                t_ns=self.clock.now_ns(),
                own_t_ns=t_mono_ns,
                event=self.clock.number,
                source=source,
                data=data,
            )
            self.decided.append(entry)

    @property
    def failed(self) -> bool:
        return False

    def counters(self) -> dict[str, int]:
        return {"written": len(self.decided), "dropped": 0}


def input_events(messages: Iterable[LoggedMessage], wall_minus_mono_ns: int) -> Iterator[InputEvent]:
    """The events of a log. `messages` in file order, inputs only."""
    for number, group in itertools.groupby(messages, key=lambda message: message.sequence):
        inputs: dict[str, list[bytes]] = {}
        own_t_ns: dict[str, list[int]] = {}
        t_ns = 0
        for message in group:
            inputs.setdefault(message.topic, []).append(message.data)
            own_t_ns.setdefault(message.topic, []).append(message.publish_time_ns - wall_minus_mono_ns)
            t_ns = message.log_time_ns - wall_minus_mono_ns
        yield InputEvent(number, t_ns, inputs, own_t_ns)


class Player:
    """One replay. With `exact` the worker's answers arrive when the log says, else when they would have.

    A context, for the worker's process. Raises CompanionError for a log that cannot be replayed.
    """

    def __init__(self, session: Session, config: Config, exact: bool) -> None:
        if config.role != "uav":
            raise CompanionError(f"{session.paths[0]}: a log of role {config.role} holds no decisions to replay")
        if session.missing_parts:
            raise CompanionError(
                f"{session.paths[0]}: the first {session.missing_parts} parts of the recording are gone; a replay "
                "needs all that the service had heard"
            )
        self._session = session
        self._exact = exact
        self._base = ReplayClock(0)
        self._clock = EventClock(self._base)
        self.log = ReplayLog(self._clock, session.wall_minus_mono_ns)
        self._inputs = RecordedInputs()
        self._autopilot = RecordedAutopilot()
        self._commands: RecordedCommands | None = None
        self._surroundings = Surroundings(
            t_mono_ns=0,
            autopilot_problem="",
            parameters_checked=False,
            bad_signatures=0,
            recorder_failed=False,
            free_mib=0.0,
        )
        self.worker = RecordedWorker(config.aperture.estimator, self._clock)
        self._uav: Uav | None = None
        self.config = config
        self._latency_ns: dict[int, int] = {}
        self._usual_latency_ns = _USUAL_LATENCY_NS

    def __enter__(self) -> Player:
        self.worker.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self.worker.__exit__(*error)

    @property
    def unexpected(self) -> int:
        """Outcomes and answers that nothing in the replay had asked for."""
        return self.worker.unexpected + (0 if self._commands is None else self._commands.unexpected)

    @property
    def uav(self) -> Uav:
        """The service; there from the first event on."""
        assert self._uav is not None
        return self._uav

    def events(self, messages: Iterable[LoggedMessage]) -> Iterator[InputEvent]:
        """Handles one event after the other, and yields each when it is done. `messages` in file order; those
        that are no inputs are passed over."""
        if not self._exact:
            self._learn_latencies()
        ahead = ReadAhead(messages)
        self.worker.meanwhile = ahead.fill
        inputs = (message for message in ahead if message.topic in INPUT_TOPICS)
        for event in input_events(inputs, self._session.wall_minus_mono_ns):
            if not self._exact:
                self._answer_due(event.t_ns)
            self._base.t_ns = event.t_ns
            for data in event.inputs.get(BOOK.topic, ()):
                self._inputs.book.known = msgspec.json.decode(data, type=BookState).reached
            if self._uav is None:
                self._uav = self._build()
            self._clock.count_from(event.number)
            self._handle(event)
            yield event

    def _build(self) -> Uav:
        return Uav(
            config=self.config,
            clock=self._clock,
            recorder=self.log,
            inputs=self._inputs,
            make_autopilot=lambda odometry: self._autopilot,
            worker=self.worker,
            make_commands=self._make_commands,
            look=lambda: self._surroundings,
        )

    def _make_commands(self, autopilot: Autopilot, clock: Clock, report: Report) -> FlightCommands:
        self._commands = RecordedCommands(autopilot, clock, report)
        return self._commands

    def _handle(self, event: InputEvent) -> None:
        """What was looked at first, then what the event was."""
        for data in event.inputs.get(VEHICLE.topic, ()):
            self._autopilot.seen = msgspec.json.decode(data, type=VehicleState)
        for data in event.inputs.get(SURROUNDINGS.topic, ()):
            self._surroundings = msgspec.json.decode(data, type=Surroundings)
        outcomes = event.inputs.get(COMMAND.topic, [])
        if TICK.topic in event.inputs:  # an outcome within a tick is that of sending a set point
            failures = [msgspec.json.decode(data, type=CommandOutcome).error for data in outcomes]
            self._autopilot.send_failure = failures[0] if failures else ""
            outcomes = []
        for data in outcomes:
            assert self._commands is not None
            self._commands.deliver(msgspec.json.decode(data, type=CommandOutcome))
        for topic, payloads in event.inputs.items():
            own_t_ns = event.own_t_ns[topic]
            if topic == CSI.topic:
                self._inputs.csi.add(((record[0], record[1:]) for record in payloads), own_t_ns)
                self.uav.node.take_csi()
                continue
            for data, t_ns in zip(payloads, own_t_ns, strict=True):
                self._handle_input(topic, data, t_ns)

    def _handle_input(self, topic: str, data: bytes, own_t_ns: int) -> None:
        uav = self.uav
        if topic == POSE_IN.topic:
            self._inputs.poses.resets = int.from_bytes(data[-4:], "little")
            uav.node.take_pose(pose_of(data))
        elif topic == NEIGHBOUR.topic:
            uav.node.take_datagram(resigned(data, REPLAY_KEY), own_t_ns)
        elif topic == TICK.topic:
            tick = msgspec.json.decode(data, type=Tick)
            uav.flight.tick(tick.t_mono_ns, tick.slept_s)
        elif topic == SECOND.topic:
            uav.node.each_second()
        elif topic == WISH.topic:
            wish = msgspec.json.decode(data, type=Wish)
            uav.flight.wishes.answer(wish.wish, wish.refusal, wish.by_switch, wish.target)
        elif topic == WORKER.topic:
            is_ready = msgspec.json.decode(data, type=WorkerState).is_ready
            (self.worker.ready.set if is_ready else self.worker.ready.clear)()
        elif topic == ANSWER.topic and self._exact:
            self._hand_over(self.worker.answer(msgspec.json.decode(data, type=Answer)))
        elif topic == TAG.topic:
            uav.take_tags(sighting.decode(data))
        elif topic == END.topic:
            uav.flight.end()

    def _hand_over(self, result: AoaResult | None) -> None:
        if result is not None:
            self.uav.sar.take_answer(result)

    def _learn_latencies(self) -> None:
        """How long after the tick that ended its aperture each answer came: the n-th answer is to the n-th aperture."""
        submitted: dict[int, int] = {}
        for message in self._session.messages({APERTURE.topic, ANSWER.topic}):
            if message.topic == APERTURE.topic:
                submitted[len(submitted)] = message.log_time_ns
            elif message.topic == ANSWER.topic:
                answer = msgspec.json.decode(message.data, type=Answer)
                if answer.id in submitted:
                    self._latency_ns[answer.id] = message.log_time_ns - submitted[answer.id]
        if self._latency_ns:
            self._usual_latency_ns = round(statistics.median(self._latency_ns.values()))

    def _answer_due(self, now_ns: int) -> None:
        for request_id, asked_ns in list(self.worker.pending.items()):
            due_ns = asked_ns + self._latency_ns.get(request_id, self._usual_latency_ns)
            if due_ns <= now_ns:
                self._base.t_ns = due_ns
                answer = Answer(
                    t_mono_ns=due_ns, id=request_id, peer=0, compute_s=(due_ns - asked_ns) / 1e9, failure=""
                )
                self._hand_over(self.worker.answer(answer))
