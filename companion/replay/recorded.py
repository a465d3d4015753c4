"""What stands behind the service in a replay: nothing here reaches a device, a socket or a vehicle."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import os
import subprocess
import sys
from collections.abc import Callable, Coroutine
from types import TracebackType
from typing import Any, Final

import msgspec

from companion.aoa_process import ONE_THREAD
from companion.aoa_wire import LENGTH, AoaResult, frame, request_of
from companion.aoa_worker import READY_ID
from companion.autopilot.port import AutopilotError
from companion.child import die_with_parent
from companion.clock import Clock
from companion.errors import CompanionError
from companion.events import Answer, CommandOutcome
from companion.inputs import PoseInput
from companion.messages import Pose, Setpoint, VehicleState
from companion.vehicle_commands import Report
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
        self.records: list[tuple[int, bytes]] = []
        self._drained = 0

    @property
    def counters(self) -> SourceCounters:
        return SourceCounters(datagrams=self._drained)

    def fileno(self) -> int:
        return -1

    def drain(self, limit: int = 256) -> list[tuple[int, bytes]]:
        records, self.records = self.records, []
        self._drained += len(records)
        return records

    def close(self) -> None:
        """There is nothing to close."""


class RecordedPoses:
    """Poses are handed to the node one by one as they were recorded; there is no source to drain."""

    received = 0
    malformed = 0
    not_finite = 0

    def fileno(self) -> int:
        return -1

    def drain(self) -> None:
        """Never called."""

    def close(self) -> None:
        """There is nothing to close."""


class RecordedInputs:
    """The `Inputs` of a node in a replay."""

    def __init__(self) -> None:
        self.csi = RecordedCsi()

    def open_csi(self) -> CsiSource:
        return self.csi

    def open_poses(self, on_pose: Callable[[Pose], None]) -> PoseInput:
        return RecordedPoses()

    def key(self, name: str) -> bytes:
        return REPLAY_KEY

    async def open_link(self, on_datagram: Callable[[bytes], None]) -> asyncio.DatagramTransport:
        raise CompanionError("a replay has no radio link")


class RecordedAutopilot:
    """An `Autopilot` whose state is what the log says was seen; set points end here."""

    def __init__(self) -> None:
        self.seen = VehicleState(0)

    def state(self) -> VehicleState:
        return self.seen

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Goes nowhere."""

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

    async def parameter(self, name: str) -> int | float:
        raise AutopilotError(f"parameter {name}: a replay has no autopilot")


class RecordedCommands:
    """Commands are not run: each waits for the outcome that the log gives."""

    def __init__(self) -> None:
        self._report: Report | None = None
        self.unexpected = 0
        """Outcomes of commands that the replay had not started."""

    def start(self, command: Coroutine[Any, Any, None], report: Report) -> None:
        command.close()
        self._report = report

    def cancel(self) -> None:
        self._report = None

    def deliver(self, outcome: CommandOutcome) -> None:
        """The outcome of the command that runs."""
        report, self._report = self._report, None
        if report is None:
            self.unexpected += 1
            return
        report(AutopilotError(outcome.error) if outcome.error else None)

    async def __aenter__(self) -> RecordedCommands:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> bool | None:
        return None


class RecordedWorker:
    """The service's own AOA worker process, asked in step: answers are computed anew and handed over when the log says.

    A context: the process ends with it.
    """

    def __init__(self, estimator: str, clock: Clock) -> None:
        self._clock = clock
        self._is_ready = False
        self._next_id = 0
        self._asked: list[int] = []
        self._computed: dict[int, AoaResult] = {}
        self.pending: dict[int, int] = {}
        """When each aperture without an answer was submitted [ns]."""
        self.unexpected = 0
        """Answers to apertures that the replay did not submit."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "companion.aoa_worker", estimator],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
            preexec_fn=die_with_parent,
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
            return AoaResult(recorded.id, recorded.peer, recorded.compute_s, refusal=recorded.failure, failed=True)
        self._collect()
        return dataclasses.replace(self._computed.pop(recorded.id), compute_s=recorded.compute_s)

    def _collect(self) -> None:
        while self._asked:
            result = self._read()
            assert result.id == self._asked.pop(0)
            self._computed[result.id] = result

    def _read(self) -> AoaResult:
        assert self._process.stdout is not None
        head = self._process.stdout.read(LENGTH.size)
        if len(head) < LENGTH.size:
            raise CompanionError("the AOA worker of the replay ended; its error stands above")
        return msgspec.msgpack.decode(self._process.stdout.read(*LENGTH.unpack(head)), type=AoaResult)


def _refuse(what: str) -> None:
    raise AutopilotError(f"{what}: a replay commands nothing")
