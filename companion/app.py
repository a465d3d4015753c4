"""Wires the parts into a service, one TaskGroup: a task that dies stops it, loudly."""

from __future__ import annotations

import asyncio
import logging
import signal
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.config.schema import Config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.messages import Pose
from companion.core.recorder import Recorder
from companion.errors import CompanionError
from companion.host.control_socket import ControlServer
from companion.host.notify import notify
from companion.log.lines import record_lines
from companion.log.recorder import McapRecorder
from companion.radio.card import ChannelSample
from companion.roles.beacon import Beacon
from companion.roles.inputs import LiveInputs
from companion.roles.node import Node
from companion.roles.uav import Uav
from companion.sensing.iterations import Worker
from companion.sensing.worker_process import AoaProcess
from companion.sensing.worker_wire import AoaResult

_log = logging.getLogger(__name__)
_WATCHDOG_S = 1.0


class _Stopped(Exception):
    """Somebody asked the service to end."""


async def serve(config: Config) -> None:
    """Runs until SIGTERM or SIGINT. Raises CompanionError when a part cannot start or dies."""
    clock = EventClock(MonotonicClock())
    recorder = McapRecorder(config.path(config.recorder.path), config, clock)
    service = _serve_uav if config.role == "uav" else _serve_beacon
    lines = record_lines(recorder)
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
    url, system_id = config.autopilot.url, config.autopilot.system_id
    uav = Uav(
        config,
        clock,
        recorder,
        LiveInputs(config),
        lambda node: MavsdkAutopilot(url, MonotonicClock(), node.odometry_sink(), system_id),
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
