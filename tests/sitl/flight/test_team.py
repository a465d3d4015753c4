"""A flight with its team, whose process is killed and stopped: set points go out as before, and it comes back."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable
from typing import Any

import pytest

from tests.sitl.flying import Flying, flies_on

pytestmark = pytest.mark.asyncio(loop_scope="package")
_WORKER = "companion.team.worker"
_PATIENCE_S = 60.0


@pytest.mark.long
async def test_fault_59_a_team_killed_or_stopped_costs_the_flight_nothing(flying: Flying) -> None:
    await flying.fly()
    team = await _told(flying, lambda team: any(robot["sightings"] for robot in team["robots"].values()))
    assert len(team["robots"]) == len(flying.stage.uav.peers)
    (pid,) = flying.children(_WORKER)
    first = await flying.px4()
    os.kill(pid, signal.SIGSTOP)
    await asyncio.sleep(3.0)
    os.kill(pid, signal.SIGKILL)
    await _told(flying, lambda team: team["restarts"] == 1 and team["age_s"] < 2.0)
    last = await flying.px4()
    status = await flying.status()
    assert flies_on(status), (status["state"], status["reason"])
    assert last.mode in ("OFFBOARD", "HOLD") and last.setpoints > first.setpoints
    assert last.largest_gap_s < 0.5


async def _told(flying: Flying, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    team: dict[str, Any] = {}
    async with asyncio.timeout(_PATIENCE_S):
        while True:
            team = (await flying.status())["team"]
            if team["age_s"] is not None and is_so(team):
                return team
            await asyncio.sleep(0.2)
