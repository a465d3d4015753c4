"""Observe mode, the default: a whole service computes and logs everything while a person flies, and commands nothing.

What it sent is judged by what the autopilot received: every message and every command is counted there by its name.
"""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec

from companion.config.schema import MissionConfig
from companion.log.reader import read_log
from tests.sitl.flying import Flying, flying
from tests.sitl.topics import SERVICE_TOPICS

_ASKS_AND_TELLS = {
    "HEARTBEAT",
    "TIMESYNC",
    "ONBOARD_COMPUTER_STATUS",
    "PING",  # of the library
    "PARAM_REQUEST_READ",
    "PARAM_REQUEST_LIST",
    "COMMAND_LONG 511",  # SET_MESSAGE_INTERVAL
    "COMMAND_LONG 512",  # REQUEST_MESSAGE
    "COMMAND_LONG 520",  # REQUEST_AUTOPILOT_CAPABILITIES, of the library
}
"""All that may reach an autopilot that is only observed: nothing of it moves, arms or changes a mode or a parameter."""
_COMPUTED = {"/bearing", "/target", "/aoa/profile", "/aperture", "/observed_setpoint", "/pose", "/vehicle", "/csi"}


async def _fly_a_square(flight: Flying) -> None:
    """A person climbs and flies once around: a path that tells left from right."""
    await flight.px4("sticks 0 0 1")
    await asyncio.sleep(1.5)
    for east, north in ((0.5, 0.0), (0.0, 0.5), (-0.5, 0.0), (0.0, -0.5)):
        await flight.px4(f"sticks {east} {north} 0")
        await asyncio.sleep(1.2)


def _steers(flight: Flying, status: dict[str, Any]) -> bool:
    """Whether the newest bearing is one that would be followed: on a loaded machine the first need not be."""
    bearing = status["bearing"]
    return bearing is not None and bearing["reliability"] >= flight.stage.uav.aperture.min_reliability


async def _observed(folder: Path) -> None:
    # A switch that stands for engaging must not do it either.
    async with flying(folder, autopilot={"engage_rc_channel": 3}, control="observe") as flight:
        only = "the service observes; mission.control: fly lets it be engaged"
        await flight.until(lambda status: status["not_ready"] == [only], 60.0)
        refused = await flight.command("engage")
        assert not refused["ok"] and only in refused["error"]
        for width_us in (1000, 1900):
            await flight.px4(f"rc 1500 1500 {width_us}")
            await asyncio.sleep(0.5)
        async with asyncio.timeout(60):
            while not _steers(flight, await flight.status()):
                await _fly_a_square(flight)
        await asyncio.sleep(1.0)  # with what is known now there is a set point to be computed at each tick
        status = await flight.status()
        assert status["state"] == "idle" and not status["streaming"] and status["control"] == "observe"
        assert (await flight.command("abort"))["ok"]
        os.kill(flight.cast.pid("uav"), signal.SIGTERM)  # in the air: whoever flies it goes on flying it
        assert await asyncio.wait_for(flight.cast.wait("uav"), 10.0) == 0
        report = await flight.px4()
    print(report.received)
    assert set(report.received) <= _ASKS_AND_TELLS
    assert report.setpoints == 0 and report.received["HEARTBEAT"] > 5
    assert [mode for _, mode in report.history] == ["HOLD", "POSCTL"] and report.armed and not report.landed


async def test_an_observing_service_computes_all_and_commands_nothing(tmp_path: Path) -> None:
    assert MissionConfig().control == "observe", "the default"
    await _observed(tmp_path)
    log = tmp_path / "log.mcap"
    messages = list(read_log(log, SERVICE_TOPICS))
    logged = Counter(message.topic for message in messages)
    assert logged.keys() >= _COMPUTED and "/setpoint" not in logged
    assert logged["/observed_setpoint"] > 10
    wanted = [msgspec.json.decode(m.data) for m in messages if m.topic == "/observed_setpoint"]
    assert all(len(observed["setpoint"]["p_local_enu_m"]) == 3 for observed in wanted)
    command = [sys.executable, "-m", "companion", "replay", str(log), "--check"]
    done = await asyncio.to_thread(subprocess.run, command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
