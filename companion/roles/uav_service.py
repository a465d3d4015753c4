"""Role uav on a vehicle: its devices, its tasks, and what it answers on the control socket."""

from __future__ import annotations

import asyncio
import logging
from dataclasses import asdict
from typing import Any

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import Autopilot
from companion.camera.sighting import TagFrame
from companion.config.schema import Config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.host.control_socket import ControlServer
from companion.host.ending import Ending, Parts
from companion.host.notify import feed_watchdog, notify
from companion.host.priority import keep_priority, raise_priority
from companion.log.feed import introduction
from companion.mission.table import AT_REST
from companion.pose.port import PoseSink
from companion.roles.ground import Ground
from companion.roles.inputs import LiveInputs
from companion.roles.live import LiveStreams
from companion.roles.page import Page
from companion.roles.tag_camera import TagCamera
from companion.roles.tak import Tak
from companion.roles.team import TeamOf
from companion.roles.uav import Uav
from companion.sensing.worker_process import AoaProcess
from companion.signing.autopilot import SignedAutopilot, signing_relay

_log = logging.getLogger(__name__)


async def serve_uav(config: Config, clock: EventClock, recorder: Recorder, ending: Ending) -> None:
    """Runs until cancelled. Raises CompanionError when a part cannot start or dies."""
    assert config.autopilot is not None
    url, system_id = config.autopilot.url, config.autopilot.system_id
    worker = AoaProcess(config.aperture.estimator, config.aperture.worker_timeout_s)
    live = LiveStreams(config, clock, recorder)
    page = Page(config, clock, live.recorder)
    ground = Ground(config, clock, page.recorder)
    tak = Tak(config, clock, ground.recorder)
    relay = signing_relay(config)
    edges: list[MavsdkAutopilot] = []

    def make_autopilot(odometry: PoseSink | None) -> Autopilot:
        # Its telemetry is stamped on a thread of the library's own, by a clock that never stands still.
        edge = MavsdkAutopilot(
            relay.url if relay else url,
            MonotonicClock(),
            odometry,
            system_id,
            is_of_vehicle=ground.is_on,
            wants_gps=config.tak.enabled,
        )
        edges.append(edge)
        return SignedAutopilot(edge, relay) if relay else edge

    uav = Uav(
        config=config,
        clock=clock,
        recorder=tak.recorder,
        inputs=LiveInputs(config),
        make_autopilot=make_autopilot,
        worker=worker,
    )

    def may_wait() -> bool:
        return uav.flight.state in AT_REST and not edges[-1].is_armed

    team = TeamOf(uav.node)
    tag_camera = TagCamera(config, lambda frame: _take_tags(uav, frame))
    uav.sar.iterations.connect(team.add_iteration)
    worker.answers.connect(uav.sar.take_answer)
    worker.readiness.connect(uav.sar.note_worker)
    sockets = config.path(config.control_socket), config.path(config.status_socket)
    control = ControlServer(sockets[0], lambda command, target: _answer(uav, team, command, target), sockets[1])
    try:
        uav.node.open()
        await control.open()
        without = raise_priority()
        async with Parts(ending.begin) as tasks:
            tasks.create_task(uav.node.run(ending.begin, may_wait), name="node")
            tasks.create_task(worker.run(), name="aoa")
            tasks.create_task(control.run(), name="control")
            tasks.create_task(uav.autopilot.run(), name="autopilot")
            tasks.create_task(uav.flight.run(), name="flight")
            tasks.create_task(feed_watchdog(uav.flight.is_ticking), name="watchdog")
            tasks.create_task(keep_priority(), name="priority")
            live.start()
            page.start(uav.flight.status)
            ground.start(uav.flight.status, edges[-1].ground)
            team.start()
            tag_camera.start()
            tak.start(lambda: {"target_id": uav.flight.knowledge.neighbour.id})
            await asyncio.sleep(0)  # each of them has begun
            ending.started()
            notify("READY=1")
            _log.log(logging.WARNING if without else logging.INFO, without or "the control loop runs in real time")
    finally:
        control.close()
        uav.node.close()
        await ground.aclose()
        await uav.autopilot.aclose()
        await team.aclose()
        await tag_camera.aclose()
        await tak.aclose()
        await page.aclose()
        await live.aclose()


async def _answer(uav: Uav, team: TeamOf, command: str, target: str | None) -> dict[str, Any]:
    if target is not None and command != "engage":
        return {"ok": False, "error": f"{command} takes no target"}
    uav.node.read()  # a person sees, and engages by, what has arrived by now
    match command:
        case "status":
            about = introduction(uav.node.config, "live")
            status = uav.flight.status() | {"team": team.status()}
            return {"ok": True, "about": about, **status, "health": asdict(uav.node.health())}
        case "engage":
            wishes = uav.flight.wishes
            refusal = await wishes.engage(target)
            return {"ok": not refusal, "error": refusal, "vehicle": wishes.vehicle, "target": wishes.target}
        case "abort":
            uav.flight.wishes.abort()
            return {"ok": True, "error": ""}
        case "pose":
            return uav.node.pose_answer(uav.autopilot.state().yaw_enu_rad)
    return {"ok": False, "error": f"unknown command {command!r}; known: engage, abort, status, pose"}


def _take_tags(uav: Uav, frame: TagFrame) -> None:
    """Our poses up to the frame first: it is judged by the nearest one."""
    uav.node.read()
    uav.take_tags(frame)
