"""One whole mission, from the ground to the ground, on the mock. On a real PX4: test_real_px4.py.

It uses only what the service offers a person, so it depends on no autopilot's timing.
"""

from __future__ import annotations

import asyncio
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from tests.sitl.flying import Flying, flying


async def _mission(flight: Flying) -> None:
    """Take off, approach, lose the target, be left to land as mission.lost_target says, and be idle on the ground."""

    def flown(status: dict[str, Any]) -> bool:
        return status["state"] == "approaching" and status["bearing"] is not None

    await flight.engage(timeout_s=120.0)
    status = await flight.until(flown, 180.0)
    assert status["vehicle"]["mode"] == "offboard" and status["vehicle"]["in_air"] and status["streaming"]
    assert abs(status["vehicle"]["p_local_enu_m"][2] - flight.stage.uav.mission.takeoff_height_m) < 0.6
    beacon = flight.cast.pid("beacon")
    os.kill(beacon, signal.SIGSTOP)
    try:
        await flight.in_state("holding", timeout_s=15.0)
        await flight.in_state("landing", timeout_s=30.0)
        status = await flight.in_state("idle", timeout_s=90.0)
    finally:
        os.kill(beacon, signal.SIGCONT)
    assert status["reason"] == "landed" and not status["streaming"]
    status = await flight.until(lambda status: not status["vehicle"]["armed"], 30.0)
    since_s = time.monotonic()
    while time.monotonic() - since_s < 2.0:  # PX4 would go back to OFFBOARD once it has disarmed
        assert (await flight.status())["vehicle"]["mode"] != "offboard"
        await asyncio.sleep(0.1)


@pytest.mark.long
async def test_a_whole_mission_on_the_mock(tmp_path: Path) -> None:
    # Long enough that a hold for want of a first bearing, where the machine is busy, is not its end.
    async with flying(tmp_path, lost_target="return", hold_limit_s=15.0, setpoints="velocity", yaw="target") as flight:
        await _mission(flight)
