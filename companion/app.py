"""Wires the parts into a service, one TaskGroup: a task that dies stops it, loudly."""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import signal
import time
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from companion.aoa_process import AoaProcess
from companion.aoa_wire import AoaResult
from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.observed import ObservedAutopilot
from companion.autopilot.port import Autopilot
from companion.beacon import Beacon
from companion.clock import MonotonicClock
from companion.config import Config
from companion.control import ControlServer
from companion.errors import CompanionError
from companion.event_clock import EventClock
from companion.events import Answer, WorkerState
from companion.flight import Flight
from companion.flight_commands import FlightCommands, MakeCommands
from companion.inputs import Inputs, LiveInputs
from companion.log.foxglove import LogLine
from companion.messages import Pose
from companion.node import Node
from companion.notify import notify
from companion.pose.forward import VioForwarder
from companion.radio import ChannelSample
from companion.recorder import McapRecorder, Recorder
from companion.sar import ApertureRecord, Iteration, SarIterations, Worker
from companion.streams import ANSWER, LOG, WORKER
from companion.surroundings import Surroundings
from companion.window import SarWindow
from wsr.channel import wavelength_m

_log = logging.getLogger(__name__)
_WATCHDOG_S = 1.0


class _Stopped(Exception):
    """Somebody asked the service to end."""


async def serve(config: Config) -> None:
    """Runs until SIGTERM or SIGINT. Raises CompanionError when a part cannot start or dies."""
    clock = EventClock(MonotonicClock())
    recorder = McapRecorder(config.path(config.recorder.path), config, clock)
    service = _serve_uav if config.role == "uav" else _serve_beacon
    lines = _record_lines(recorder)
    try:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(_until_signal(), name="signals")
            tasks.create_task(service(config, clock, recorder), name=config.role)
    except* _Stopped:
        _log.info("stopped on request")
    except* CompanionError as group:
        raise _first(group) from None
    finally:
        notify("STOPPING=1")
        logging.getLogger().removeHandler(lines)
        await asyncio.to_thread(recorder.close)


class Uav:
    """The parts of role uav, wired. What they stand on is given: live, or a log."""

    def __init__(
        self,
        config: Config,
        clock: EventClock,
        recorder: Recorder,
        inputs: Inputs,
        make_autopilot: Callable[[Node], Autopilot],
        make_worker: Callable[[Callable[[AoaResult], None], Callable[[bool], None]], Worker],
        make_commands: MakeCommands = FlightCommands,
        look: Callable[[], Surroundings] | None = None,
    ) -> None:
        assert config.autopilot is not None
        aperture = config.aperture
        self._clock = clock
        self._recorder = recorder
        self._refuses_lookalikes = config.neighbours.refuse_lookalikes
        self._window = SarWindow(
            config.pose.antenna_m, wavelength_m(config.csi.channel), aperture.min_packets, aperture.max_pose_gap_s
        )
        self.node = node = Node(config, clock, recorder, self._take_sample, self._take_pose, inputs)
        self._window.nic_clock = node.radio.nic_clock
        self.autopilot = ObservedAutopilot(make_autopilot(node), clock, recorder)
        self._forwarder = VioForwarder(self.autopilot, node.intake, config.autopilot.forward_vio_hz)
        self.sar = SarIterations(
            self._window,
            make_worker(self.take_answer, self.take_worker_state),
            node.receiver.neighbours,
            aperture,
            clock,
            self._take_iteration,
            node.intake.problem_between,
            self._take_aperture,
        )
        self.flight = Flight(config, clock, node, self.autopilot, self.sar, recorder, make_commands, look)

    def take_answer(self, result: AoaResult) -> None:
        """The worker has answered."""
        with self._clock.event() as now_ns:
            failure = result.refusal if result.failed else ""
            self._recorder.record(ANSWER, now_ns, Answer(now_ns, result.id, result.peer, result.compute_s, failure))
            self.sar.take(result)

    def take_worker_state(self, is_ready: bool) -> None:
        """A worker has begun or ceased to wait for apertures."""
        with self._clock.event() as now_ns:
            self._recorder.record(WORKER, now_ns, WorkerState(now_ns, is_ready))

    def _take_sample(self, sample: ChannelSample) -> None:
        self._window.add_sample(sample)
        self.flight.heard(sample.peer, sample.t_mono_ns)

    def _take_pose(self, pose: Pose) -> None:
        self._window.add_pose(pose)
        self._forwarder.take(pose)

    def _take_aperture(self, aperture: ApertureRecord) -> None:
        self.flight.take_aperture(aperture)

    def _take_iteration(self, iteration: Iteration, profile: bytes) -> None:
        doubt = self.node.lookalikes.add(iteration.peer, iteration.start_ns, profile)
        if doubt and self._refuses_lookalikes:
            iteration = dataclasses.replace(iteration, estimate=None, refusal=doubt)
        self.flight.take(iteration, profile)


async def _serve_beacon(config: Config, clock: EventClock, recorder: Recorder) -> None:
    def on_sample(sample: ChannelSample) -> None:
        beacon.add_sample(sample)

    node = Node(config, clock, recorder, on_sample, _ignore)
    beacon = Beacon(node.sender)

    async def answer(command: str) -> dict[str, Any]:
        if command != "status":
            return {"ok": False, "error": f"role beacon knows no command {command!r}; it takes: status"}
        return {"ok": True, "state": "beacon", "health": _plain(node)}

    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(node.run(), name="node")
        tasks.create_task(ControlServer(config.path(config.control_socket), answer).run(), name="control")
        tasks.create_task(_feed_watchdog(lambda: True), name="watchdog")  # a beacon has no loop beside this one
        notify("READY=1")


async def _serve_uav(config: Config, clock: EventClock, recorder: Recorder) -> None:
    assert config.autopilot is not None
    process: AoaProcess

    def make_worker(on_result: Callable[[AoaResult], None], on_ready: Callable[[bool], None]) -> Worker:
        nonlocal process
        aperture = config.aperture
        process = AoaProcess(aperture.estimator, aperture.worker_timeout_s, on_result, on_ready=on_ready)
        return process

    # Its telemetry is stamped on a thread of the library's own, by a clock that never stands still.
    url = config.autopilot.url
    uav = Uav(
        config,
        clock,
        recorder,
        LiveInputs(config),
        lambda node: MavsdkAutopilot(url, MonotonicClock(), node.odometry_sink()),
        make_worker,
    )
    node, flight, autopilot = uav.node, uav.flight, uav.autopilot

    async def answer(command: str) -> dict[str, Any]:
        if command == "status":
            return {"ok": True, **flight.status(), "health": _plain(node)}
        if command == "engage":
            refusal = await flight.engage()
            return {"ok": not refusal, "error": refusal}
        if command == "abort":
            flight.abort()
            return {"ok": True, "error": ""}
        if command == "pose":
            return _pose_answer(node, autopilot.state().yaw_enu_rad)
        return {"ok": False, "error": f"unknown command {command!r}; known: engage, abort, status, pose"}

    try:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(node.run(), name="node")
            tasks.create_task(process.run(), name="aoa")
            tasks.create_task(ControlServer(config.path(config.control_socket), answer).run(), name="control")
            tasks.create_task(autopilot.run(), name="autopilot")
            tasks.create_task(flight.run(), name="flight")
            tasks.create_task(_feed_watchdog(flight.is_ticking), name="watchdog")
            notify("READY=1")
    finally:
        await autopilot.aclose()


class _RecordingHandler(logging.Handler):
    """The program's own log into the flight's."""

    def __init__(self, recorder: Recorder) -> None:
        super().__init__(logging.INFO)
        self._recorder = recorder

    def emit(self, record: logging.LogRecord) -> None:
        line = LogLine(record.levelno, record.name, record.getMessage())
        self._recorder.record(LOG, time.monotonic_ns(), line)


def _record_lines(recorder: Recorder) -> logging.Handler:
    handler = _RecordingHandler(recorder)
    logging.getLogger().addHandler(handler)
    return handler


async def _until_signal() -> None:
    asked = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, asked.set)
    await asked.wait()
    raise _Stopped


async def _feed_watchdog(is_alive: Callable[[], bool]) -> None:
    """Feeds systemd's watchdog while the role's own loop runs, not merely while this one does."""
    while True:
        await asyncio.sleep(_WATCHDOG_S)
        if is_alive():
            notify("WATCHDOG=1")


def _pose_answer(node: Node, autopilot_yaw_rad: float | None) -> dict[str, Any]:
    pose, problem = node.intake.newest, node.intake.problem()
    if pose is None or problem:
        return {"ok": False, "error": f"no poses to check: {problem or node.intake.north_problem()}"}
    return {"ok": True, **asdict(pose), "autopilot_yaw_rad": autopilot_yaw_rad}


def _plain(node: Node) -> dict[str, Any]:
    return asdict(node.health())


def _ignore(pose: Pose) -> None:
    """A beacon's own poses go out with its datagrams, which the node sees to."""


def _first(group: BaseExceptionGroup[Any]) -> CompanionError:
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    assert isinstance(error, CompanionError)
    return error
