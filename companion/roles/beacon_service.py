"""Role beacon on a robot: its tasks, and what it answers on the control socket."""

from __future__ import annotations

import asyncio
from dataclasses import asdict
from typing import Any

from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.host.control_socket import ControlServer
from companion.host.ending import Ending, Parts
from companion.host.notify import feed_watchdog, notify
from companion.log.feed import introduction
from companion.roles.beacon import Beacon
from companion.roles.inputs import LiveInputs
from companion.roles.live import LiveStreams
from companion.roles.node import Node
from companion.roles.page import Page
from companion.roles.team import TeamOf


async def serve_beacon(config: Config, clock: EventClock, recorder: Recorder, ending: Ending) -> None:
    """Runs until cancelled. Raises CompanionError when a part cannot start or dies."""
    live = LiveStreams(config, clock, recorder)
    page = Page(config, clock, live.recorder)
    node = Node(config, clock, page.recorder, LiveInputs(config))
    node.samples.connect(Beacon(node.sender).add_sample)
    team = TeamOf(node)
    sockets = config.path(config.control_socket), config.path(config.status_socket)
    control = ControlServer(sockets[0], lambda command, target: _answer(node, team, command), sockets[1])
    try:
        node.open()
        await control.open()
        async with Parts(ending.begin) as tasks:
            tasks.create_task(node.run(ending.begin), name="node")
            tasks.create_task(control.run(), name="control")
            tasks.create_task(feed_watchdog(lambda: True), name="watchdog")  # a beacon has no loop beside this one
            live.start()
            page.start(lambda: {"state": "beacon"})
            team.start()
            await asyncio.sleep(0)  # each of them has begun
            ending.started()
            notify("READY=1")
    finally:
        control.close()
        node.close()
        await team.aclose()
        await page.aclose()
        await live.aclose()


async def _answer(node: Node, team: TeamOf, command: str) -> dict[str, Any]:
    match command:
        case "status":
            health = asdict(node.health())
            about = introduction(node.config, "live")
            return {"ok": True, "about": about, "state": "beacon", "team": team.status(), "health": health}
        case "pose":
            return node.pose_answer(None)
    return {"ok": False, "error": f"role beacon knows no command {command!r}; it takes: status, pose"}
