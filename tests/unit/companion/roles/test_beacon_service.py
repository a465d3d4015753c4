"""What a beacon answers on its control socket: its status, and its poses to who checks their axes."""

from __future__ import annotations

import asyncio
from pathlib import Path

from companion.core.event_clock import EventClock
from companion.log.recorder import McapRecorder
from companion.roles.beacon_service import _answer
from companion.roles.inputs import LiveInputs
from companion.roles.node import Node
from companion.roles.team import TeamOf
from companion.sim.stage import set_stage
from tests.level_pose import level_pose
from tests.manual_clock import ManualClock


def test_a_beacon_tells_its_poses_and_is_commanded_by_nobody(tmp_path: Path) -> None:
    config = set_stage(tmp_path, tmp_path, seed=1, use_netlink=False).beacon
    clock = EventClock(ManualClock(10**12))
    recorder = McapRecorder(config.path(config.recorder.path), config, clock)
    node = Node(config, clock, recorder, LiveInputs(config))
    try:
        team = TeamOf(node)
        assert asyncio.run(_answer(node, team, "pose")) == {"ok": False, "error": "no poses to check: no poses"}
        for number in range(40):
            node.take_pose(level_pose(10**12 - (39 - number) * 5_000_000, (1.0, 2.0, 0.5)))
        told = asyncio.run(_answer(node, team, "pose"))
        assert told["ok"] and told["p_enu_m"] == (1.0, 2.0, 0.5) and told["autopilot_yaw_rad"] is None
        assert asyncio.run(_answer(node, team, "status"))["state"] == "beacon"
        refused = asyncio.run(_answer(node, team, "engage"))
        assert refused["error"] == "role beacon knows no command 'engage'; it takes: status, pose"
    finally:
        recorder.close()
        node.close()
