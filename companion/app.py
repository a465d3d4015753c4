"""Wires the parts into a service, one TaskGroup: a task that dies stops it, loudly."""

from __future__ import annotations

import asyncio
import dataclasses
import importlib.metadata
import logging
import signal
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from companion.aoa_process import AoaProcess
from companion.aoa_wire import AoaResult
from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.beacon import Beacon
from companion.clock import Clock, MonotonicClock
from companion.config import Config
from companion.control import ControlServer
from companion.errors import CompanionError
from companion.flight import Flight
from companion.messages import Pose
from companion.node import Node
from companion.notify import notify
from companion.pose.forward import VioForwarder
from companion.radio import ChannelSample
from companion.recorder import Recorder
from companion.sar import Iteration, SarIterations
from companion.window import SarWindow
from wsr.channel import wavelength_m

_log = logging.getLogger(__name__)
_WATCHDOG_S = 1.0


class _Stopped(Exception):
    """Somebody asked the service to end."""


async def serve(config: Config) -> None:
    """Runs until SIGTERM or SIGINT. Raises CompanionError when a part cannot start or dies."""
    recorder = Recorder(
        config.path(config.recorder.path),
        config,
        importlib.metadata.version("wsr-companion"),
        config.recorder.queue_messages,
    )
    service = _serve_uav if config.role == "uav" else _serve_beacon
    try:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(_until_signal(), name="signals")
            tasks.create_task(service(config, MonotonicClock(), recorder), name=config.role)
    except* _Stopped:
        _log.info("stopped on request")
    except* CompanionError as group:
        raise _first(group) from None
    finally:
        notify("STOPPING=1")
        await asyncio.to_thread(recorder.close)


async def _serve_beacon(config: Config, clock: Clock, recorder: Recorder) -> None:
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


async def _serve_uav(config: Config, clock: Clock, recorder: Recorder) -> None:
    assert config.autopilot is not None
    aperture = config.aperture
    window = SarWindow(
        config.pose.antenna_m, wavelength_m(config.csi.channel), aperture.min_packets, aperture.max_pose_gap_s
    )

    def on_sample(sample: ChannelSample) -> None:
        window.add_sample(sample)
        flight.heard(sample.peer, sample.t_mono_ns)

    def on_result(result: AoaResult) -> None:
        sar.take(result)

    def on_iteration(iteration: Iteration, profile: bytes) -> None:
        doubt = node.lookalikes.add(iteration.peer, iteration.start_ns, profile)
        if doubt and config.neighbours.refuse_lookalikes:
            iteration = dataclasses.replace(iteration, estimate=None, refusal=doubt)
        flight.take(iteration, profile)

    def on_pose(pose: Pose) -> None:
        window.add_pose(pose)
        forwarder.take(pose)

    node = Node(config, clock, recorder, on_sample, on_pose)
    window.nic_clock = node.radio.nic_clock
    process = AoaProcess(aperture.estimator, aperture.worker_timeout_s, on_result)
    trouble = node.intake.problem_between
    sar = SarIterations(window, process, node.receiver.neighbours, aperture, clock, on_iteration, trouble)
    autopilot = MavsdkAutopilot(config.autopilot.url, clock, node.odometry_sink())
    forwarder = VioForwarder(autopilot, node.intake, config.autopilot.forward_vio_hz)
    flight = Flight(config, clock, node, autopilot, sar, recorder)

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
