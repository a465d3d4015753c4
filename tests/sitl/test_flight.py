"""The whole service against the mock autopilot: when somebody else decides, when it stands still, in silence."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import tempfile
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from companion.control import ask
from companion.errors import CompanionError
from companion.sim import truth
from companion.sim.stage import Cast, Stage, set_stage
from companion.sim.truth import WorldTruth
from companion.unix_datagram import bind_datagram_socket

SEED = 5


class Flight:
    """A running cast, its newest truth and its status."""

    def __init__(self, stage: Stage, cast: Cast, px4_control: Path) -> None:
        self._stage = stage
        self._px4_control = px4_control
        self.cast = cast
        self.truths: list[WorldTruth] = []

    @property
    def now(self) -> WorldTruth:
        return self.truths[-1]

    async def status(self) -> dict[str, Any]:
        return await ask(self._stage.control_socket, "status")

    async def command(self, command: str) -> dict[str, Any]:
        return await ask(self._stage.control_socket, command)

    def order(self, text: str) -> None:
        """To the mock autopilot: what its pilot or its link does."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            sock.sendto(text.encode(), str(self._px4_control))

    async def until(self, condition: Callable[[dict[str, Any]], bool], timeout_s: float = 60.0) -> dict[str, Any]:
        async with asyncio.timeout(timeout_s):
            while True:
                await asyncio.sleep(0.02)
                try:
                    status = await self.status()
                except CompanionError:  # not listening yet
                    continue
                if condition(status):
                    return status

    async def in_state(self, state: str, timeout_s: float = 60.0) -> dict[str, Any]:
        return await self.until(lambda status: status["state"] == state, timeout_s)

    async def engage(self) -> None:
        await self.until(lambda status: not status["not_ready"])
        assert (await self.command("engage"))["ok"]


@asynccontextmanager
async def flight(out: Path) -> AsyncIterator[Flight]:
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        stage = set_stage(Path(name), out, SEED, use_netlink=False)
        px4_control = Path(name) / "px4.sock"
        with bind_datagram_socket(stage.truth_socket) as sock:
            async with Cast(stage, out, "--control", str(px4_control)) as cast:
                flying = Flight(stage, cast, px4_control)
                listening = asyncio.create_task(_listen(sock, flying.truths))
                try:
                    yield flying
                finally:
                    listening.cancel()


async def _listen(sock: socket.socket, truths: list[WorldTruth]) -> None:
    while True:
        truths.append(truth.decode_world(await asyncio.get_running_loop().sock_recv(sock, 4096)))


@pytest.fixture
async def flying(tmp_path: Path) -> AsyncIterator[Flight]:
    async with flight(tmp_path) as started:
        yield started


@pytest.mark.parametrize("stall_s", [0.7, 1.2, 3.0])
async def test_fault_03_a_service_that_stood_still_is_idle_after_it(flying: Flight, stall_s: float) -> None:
    await flying.engage()
    await flying.in_state("acquiring")
    await asyncio.sleep(1.0)
    pid = flying.cast.pid("uav")
    os.kill(pid, signal.SIGSTOP)
    await asyncio.sleep(stall_s)
    stood = flying.now.vehicle
    os.kill(pid, signal.SIGCONT)
    status = await flying.in_state("latched", 5.0)
    await asyncio.sleep(2.0)
    after = flying.now.vehicle
    print(f"{after.setpoints - stood.setpoints} set points after a stall of {stall_s} s")
    assert status["reason"] in ("stalled", "mode_lost")  # whichever word of the autopilot was read first
    assert after.setpoints - stood.setpoints <= 1
    assert after.mode != "OFFBOARD"


async def test_hold_taken_by_a_person_during_the_climb_is_theirs(flying: Flight) -> None:
    await flying.engage()
    await flying.until(lambda _: flying.now.vehicle.p_enu_m[2] > 0.4, 20.0)
    flying.order("pilot HOLD")
    status = await flying.in_state("latched", 10.0)
    assert "somebody else decided" in status["reason"]
    await asyncio.sleep(1.5)
    assert flying.now.vehicle.setpoints == 0
    assert flying.now.vehicle.mode == "HOLD"


async def test_fault_09_a_pilot_is_obeyed_in_flight_and_never_overruled(flying: Flight) -> None:
    await flying.engage()
    await flying.in_state("approaching")
    flying.order("pilot POSCTL")
    await flying.in_state("latched", 2.0)
    sent = flying.now.vehicle.setpoints
    assert (await flying.command("abort"))["ok"]
    await asyncio.sleep(2.0)
    assert flying.now.vehicle.mode == "POSCTL"
    assert flying.now.vehicle.setpoints == sent


async def test_fault_29_a_silent_ground_robot_is_not_chased(flying: Flight) -> None:
    await flying.engage()
    await flying.in_state("approaching")
    os.kill(flying.cast.pid("beacon"), signal.SIGSTOP)
    await flying.in_state("holding", 10.0)
    await asyncio.sleep(1.0)
    held = flying.now
    await asyncio.sleep(5.0)
    os.kill(flying.cast.pid("beacon"), signal.SIGCONT)
    moved_m = sum((a - b) ** 2 for a, b in zip(held.vehicle.p_enu_m, flying.now.vehicle.p_enu_m, strict=True)) ** 0.5
    print(f"moved {moved_m:.2f} m in 5 s while the target was silent")
    assert moved_m < 0.3
    await flying.in_state("approaching", 15.0)


async def test_an_empty_battery_stays_on_the_ground(flying: Flight) -> None:
    await flying.until(lambda status: not status["not_ready"])
    flying.order("battery 0.05")
    await flying.until(lambda status: "the battery is low" in status["not_ready"], 10.0)
    answer = await flying.command("engage")
    assert not answer["ok"]
    assert "battery" in answer["error"]
    assert not flying.now.vehicle.armed
