"""What stands behind the service in a replay: nothing here reaches a device, a socket or a vehicle."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import itertools
import os
import select
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import Final

import msgspec

from companion.autopilot.port import Autopilot, AutopilotError
from companion.core.clock import Clock
from companion.core.inputs import Answer, CommandOutcome, Event, Reached
from companion.core.messages import AutopilotEvent, Pose, Setpoint, VehicleState
from companion.errors import CompanionError
from companion.flight.commands import Command, FlightCommands, Report
from companion.host.child import tied
from companion.host.coalescing import Readers
from companion.neighbours.boots import Book
from companion.pose.port import Poses, PoseSink
from companion.sensing.worker_process import ONE_THREAD
from companion.sensing.worker_wire import LENGTH, READY_ID, AoaResult, frame, request_of
from csi_bridge.source import CsiSource, SourceCounters
from wsr.aperture import Aperture

REPLAY_KEY: Final = bytes(32)
"""Signs the datagrams of a log for the receiver of the replay; worth nothing on the air."""


class ReplayClock:
    """Time is what the event at hand says."""

    def __init__(self, t_ns: int) -> None:
        self.t_ns = t_ns

    def now_ns(self) -> int:
        return self.t_ns

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        raise CompanionError("a replay never waits: no command runs in it")


class RecordedCsi:
    """A `CsiSource` that gives the records of the event at hand."""

    def __init__(self) -> None:
        self._records: list[tuple[int, bytes, int | None]] = []
        self._drained = 0

    def add(self, records: Iterable[tuple[int, bytes]], arrived_ns: Iterable[int | None] | None = None) -> None:
        """Code and body of each for the next `arrivals`, and when each came [ns]; without that, at the event."""
        times = itertools.repeat(None) if arrived_ns is None else arrived_ns
        self._records += ((code, body, t_ns) for (code, body), t_ns in zip(records, times, strict=False))

    @property
    def counters(self) -> SourceCounters:
        return SourceCounters(datagrams=self._drained)

    @property
    def is_stamped(self) -> bool:
        return True

    def fileno(self) -> int:
        return -1

    def drain(self, limit: int = 256) -> list[tuple[int, bytes]]:
        return [(code, body) for code, body, _ in self.arrivals(limit)]

    def gather(self, limit: int = 256) -> int:
        return 0

    def arrivals(self, limit: int = 256) -> list[tuple[int, bytes, int | None]]:
        records, self._records = self._records, []
        self._drained += len(records)
        return records

    def close(self) -> None:
        """There is nothing to close."""


class RecordedPoses:
    """Poses are handed to the node one by one as they were recorded, North-aligned as the source was then."""

    received = 0
    malformed = 0

    def __init__(self) -> None:
        self.resets = 0

    def align(self, north_yaw_rad: float) -> None:
        """The recorded poses have been turned."""

    async def run(self, readers: Readers | None = None) -> None:
        raise CompanionError("a replay has no pose source to run")

    def close(self) -> None:
        """There is nothing to close."""


class RecordedBook:
    """A `Book` as it stood when the service began; nothing is written."""

    own_boot_id = 1
    failed = False

    def __init__(self) -> None:
        self.known: Mapping[str, Reached] = {}

    def reached(self, sender: int) -> Reached | None:
        return self.known.get(str(sender))

    def note(self, sender: int, boot_id: int, counter: int) -> None:
        """A replay accepts nothing that matters."""

    def close(self) -> None:
        """There is nothing to close."""


class RecordedInputs:
    """The `Inputs` of a node in a replay."""

    def __init__(self) -> None:
        self.csi = RecordedCsi()
        self.poses = RecordedPoses()
        self.book = RecordedBook()

    def open_csi(self) -> CsiSource:
        return self.csi

    def open_poses(self, clock: Clock, sink: PoseSink) -> Poses:
        return self.poses

    def open_book(self) -> Book:
        return self.book

    def open_pinger(self, clock: Clock) -> None:
        return None

    def key(self, name: str) -> bytes:
        return REPLAY_KEY


class RecordedAutopilot:
    """An `Autopilot` whose state is what the log says was seen; set points end here."""

    problem = ""

    def __init__(self) -> None:
        self.seen = VehicleState(t_mono_ns=0)
        self.send_failure = ""
        """Why no set point can be sent in this event; empty when it can."""

    def state(self) -> VehicleState:
        return self.seen

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Goes nowhere. Raises AutopilotError where it did so in flight."""
        if self.send_failure:
            raise AutopilotError(self.send_failure)

    def send_odometry(self, pose: Pose, reset_counter: int) -> None:
        """Goes nowhere."""

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> None:
        """Goes nowhere."""

    def take_events(self) -> list[AutopilotEvent]:
        return []

    async def run(self) -> None:
        _refuse("run")

    async def connect(self, timeout_s: float = 10.0) -> None:
        _refuse("connect")

    async def aclose(self) -> None:
        """There is nothing to close."""

    async def arm(self) -> None:
        _refuse("arm")

    async def takeoff(self, height_m: float) -> None:
        _refuse("takeoff")

    async def request_offboard(self) -> None:
        _refuse("request_offboard")

    async def hold(self) -> None:
        _refuse("hold")

    async def land(self) -> None:
        _refuse("land")

    async def return_home(self) -> None:
        _refuse("return_home")

    async def parameter(self, name: str) -> int | float:
        raise AutopilotError(f"parameter {name}: a replay has no autopilot")


class RecordedCommands(FlightCommands):
    """Commands are not run: each waits for the outcome that the log gives."""

    def __init__(self, autopilot: Autopilot, clock: Clock, report: Report) -> None:
        super().__init__(autopilot, clock, report)
        self._outcomes: tuple[Event | None, Event | None] | None = None
        self._deliver = report
        self.unexpected = 0
        """Outcomes of commands that the replay had not started."""

    def start(self, command: Command, done: Event | None = None, failed: Event | None = None) -> None:
        command.close()
        self._outcomes = done, failed

    def beside(self, command: Command, name: str) -> None:
        command.close()

    def cancel(self) -> None:
        self._outcomes = None

    def deliver(self, outcome: CommandOutcome) -> None:
        """The outcome of the command that runs."""
        outcomes, self._outcomes = self._outcomes, None
        if outcomes is None:
            self.unexpected += 1
            return
        done, failed = outcomes
        self._deliver(failed if outcome.error else done, outcome.error)


class RecordedWorker:
    """The service's own AOA worker process, asked in step: answers are computed anew and handed over when the log says.

    A context: the process ends with it.
    """

    def __init__(self, estimator: str, clock: Clock) -> None:
        self._clock = clock
        self.ready = asyncio.Event()
        self._is_ready = False
        self._next_id = 0
        self._asked: list[int] = []
        self._computed: dict[int, AoaResult] = {}
        self.pending: dict[int, int] = {}
        """When each aperture without an answer was submitted [ns]."""
        self.unexpected = 0
        """Answers to apertures that the replay did not submit."""
        self.meanwhile: Callable[[], bool] = lambda: False
        """What may be done while the worker computes, a little at a time; whether there is more of it."""
        self._process = subprocess.Popen(
            tied(sys.executable, "-m", "companion.sensing.worker", estimator),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
        )

    def __enter__(self) -> RecordedWorker:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._process.kill()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
        self._process.wait()

    def submit(self, peer: int, aperture: Aperture) -> int:
        if not self._is_ready:  # it starts while the replay goes on to its first aperture
            self._is_ready = self._read().id == READY_ID
        self._collect()  # the pipe holds no two answers
        request_id, self._next_id = self._next_id, self._next_id + 1
        assert self._process.stdin is not None
        self._process.stdin.write(frame(request_of(request_id, peer, aperture)))
        self._process.stdin.flush()
        self._asked.append(request_id)
        self.pending[request_id] = self._clock.now_ns()
        return request_id

    def answer(self, recorded: Answer) -> AoaResult | None:
        """What to hand over for a recorded answer; None when it answers nothing that was asked."""
        if self.pending.pop(recorded.id, None) is None:
            self.unexpected += 1
            return None
        if recorded.failure:
            return AoaResult(
                id=recorded.id, peer=recorded.peer, compute_s=recorded.compute_s, refusal=recorded.failure, failed=True
            )
        self._collect()
        return dataclasses.replace(self._computed.pop(recorded.id), compute_s=recorded.compute_s)

    def _collect(self) -> None:
        while self._asked:
            result = self._read()
            assert result.id == self._asked.pop(0)
            self._computed[result.id] = result

    def _read(self) -> AoaResult:
        assert self._process.stdout is not None
        while not select.select([self._process.stdout], [], [], 0.0)[0] and self.meanwhile():
            pass
        head = self._process.stdout.read(LENGTH.size)
        if len(head) < LENGTH.size:
            raise CompanionError("the AOA worker of the replay ended; its error stands above")
        return msgspec.msgpack.decode(self._process.stdout.read(*LENGTH.unpack(head)), type=AoaResult)


def _refuse(what: str) -> None:
    raise AutopilotError(f"{what}: a replay commands nothing")
