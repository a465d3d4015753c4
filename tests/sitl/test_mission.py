"""One whole mission, from the ground to the ground: against the mock, and against a real PX4 where there is one.

    python -m pytest -m px4 tests/sitl/test_mission.py      # PX4 (SITL or SIH) that sends to 127.0.0.1:14540

It uses only what the service offers a person, so it depends on no autopilot's timing.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import time
from pathlib import Path
from typing import Any

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.core.clock import MonotonicClock
from tests.sitl.flying import Flying, flying

_PORT = 14540
_URL = f"udpin://127.0.0.1:{_PORT}"
_REQUIRED = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5, "COM_RC_OVERRIDE": 3, "GF_ACTION": 2, "EKF2_EV_CTRL": 0}
_REQUIRED |= {"RTL_RETURN_ALT": 3.0}


def _why_no_px4() -> str:
    """Empty when some MAVLink 2 arrives where a PX4 sends it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", _PORT))
        except OSError as error:
            return f"udp port {_PORT}: {error.strerror}"
        probe.settimeout(2.0)
        try:
            datagram = probe.recv(2048)
        except TimeoutError:
            return f"no PX4 sends to 127.0.0.1:{_PORT}"
    return "" if datagram[:1] == b"\xfd" else f"what arrives at 127.0.0.1:{_PORT} is no MAVLink 2"


async def _set_parameters() -> None:
    edge = MavsdkAutopilot(_URL, MonotonicClock())
    await edge.connect(timeout_s=30.0)
    try:
        for name, value in _REQUIRED.items():
            await edge.set_parameter(name, value)
    finally:
        await edge.aclose()


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


async def test_a_whole_mission_on_the_mock(tmp_path: Path) -> None:
    async with flying(tmp_path, lost_target="return", hold_limit_s=4.0, setpoints="velocity", yaw="target") as flight:
        await _mission(flight)


@pytest.mark.px4
async def test_a_whole_mission_on_a_real_px4(tmp_path: Path) -> None:
    if reason := await asyncio.to_thread(_why_no_px4):
        pytest.skip(reason)
    await _set_parameters()
    async with flying(tmp_path, real_url=_URL, lost_target="land") as flight:
        await _mission(flight)
