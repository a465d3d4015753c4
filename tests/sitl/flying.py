"""A whole cast for tests that fly: the service (with faults built in), a beacon, the world and the mock autopilot."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from companion.config.file import save_config
from companion.config.schema import AutopilotConfig, FoxgloveConfig, PageConfig, TakConfig, TeamConfig
from companion.errors import CompanionError
from companion.host.control_socket import ask
from companion.host.unix_datagram import bind_datagram_socket
from companion.sim.operator import engage
from companion.sim.px4.report import Px4Report
from companion.sim.scenario import encode_scenario
from companion.sim.stage import Cast, Stage, set_stage
from companion.sim.truth import WorldTruth
from tests.sitl import px4_report
from tests.sitl.ground_link import GroundLink
from tests.sitl.watching import listen

SEED = 5
HOLD_LIMIT_S = 9.0
_SOON_S = 4.0
_SERVICE = ("tests.faults.service",)
IN_OFFBOARD = ("acquiring", "approaching", "holding")


def flies_on(status: dict[str, Any]) -> bool:
    """Whether the mission goes on, or has met its target meanwhile, which a slow machine gives it the time for."""
    return (status["streaming"] and status["state"] in IN_OFFBOARD) or status["state"] == "arrived"


class Flying:
    """A running cast, its newest truth, its status, and what tests do to it."""

    def __init__(self, stage: Stage, cast: Cast, out: Path, reports: socket.socket) -> None:
        self.stage = stage
        self.cast = cast
        self.out = out
        self._reports = reports
        self.truths: list[WorldTruth] = []
        self.ground: GroundLink | None = None
        """A ground station at the mock's other link, where the test has one."""

    @property
    def now(self) -> WorldTruth:
        return self.truths[-1]

    async def status(self) -> dict[str, Any]:
        return await ask(self.stage.control_socket, "status")

    async def command(self, command: str) -> dict[str, Any]:
        return await ask(self.stage.control_socket, command, timeout_s=10.0)

    async def px4(self, order: str = "report") -> Px4Report:
        """Gives the mock an order and takes its state after it."""
        address = self.stage.directory / "px4.sock"
        async with asyncio.timeout(20.0):
            while not address.exists():  # noqa: ASYNC110 - it is still starting
                await asyncio.sleep(0.02)
        self._reports.sendto(order.encode(), str(address))
        datagram = await asyncio.wait_for(asyncio.get_running_loop().sock_recv(self._reports, 65536), 5.0)
        answer = px4_report.decode(datagram)
        assert answer.error is None, answer.error
        return answer

    def fault(self, order: str) -> None:
        """To the service: see tests.faults.service."""
        self._send(self.stage.uav.path("faults.sock"), order)

    def camera(self, order: str) -> None:
        """To the camera's reader: see tests.faults.pose_relay."""
        self._send(self.stage.directory / "camera-orders.sock", order)

    def children(self, module: str) -> list[int]:
        """Process ids of the service's children that run a module."""
        parent, found = self.cast.pid("uav"), []
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
                if int(fields[1]) == parent and module in (folder / "cmdline").read_text():
                    found.append(int(folder.name))
        return found

    async def until(self, condition: Callable[[dict[str, Any]], bool], timeout_s: float = 60.0) -> dict[str, Any]:
        status: dict[str, Any] = {}
        soon_s = time.monotonic() + _SOON_S
        try:
            async with asyncio.timeout(timeout_s):
                while True:
                    with suppress(CompanionError):  # not listening yet
                        status = await self.status()
                        if condition(status):
                            return status
                    # An answer takes the service milliseconds. What a test measures is over soon.
                    await asyncio.sleep(0.05 if time.monotonic() < soon_s else 0.2)
        except TimeoutError:
            raise AssertionError(f"not so within {timeout_s} s; the last status was {status}") from None

    async def seconds_while(self, condition: Callable[[dict[str, Any]], bool], timeout_s: float = 10.0) -> float:
        """When, from now, it was last asked for and still so: by how much this process is late does not count."""
        since_s, last_s = time.monotonic(), 0.0
        async with asyncio.timeout(timeout_s):
            while True:
                asked_s = time.monotonic() - since_s
                if not condition(await self.status()):
                    return last_s
                last_s = asked_s
                await asyncio.sleep(0.05)

    async def in_state(self, *states: str, timeout_s: float = 60.0) -> dict[str, Any]:
        return await self.until(lambda status: status["state"] in states, timeout_s)

    async def seconds_until_latched(self, since_s: float, timeout_s: float) -> float:
        """From `since_s` on the monotonic clock."""
        await self.in_state("latched", timeout_s=timeout_s)
        return time.monotonic() - since_s

    async def engage(self, timeout_s: float = 60.0) -> None:
        await engage(self.stage.control_socket, timeout_s)

    async def fly(self, *states: str) -> None:
        """Have the vehicle flown by the service, in one of `states` (any state in OFFBOARD when none is given)."""
        await self._run()
        state = (await self.until(lambda status: True))["state"]
        if state not in IN_OFFBOARD:
            await self.px4("offboard accept")
            if state not in ("idle", "latched"):
                await self.let_go()
            while (now := await self.px4()).armed and now.p_enu_m[2] <= 0:  # noqa: ASYNC110 - it is polled
                await asyncio.sleep(0.1)  # PX4 takes seconds to see that it stands
            if not now.landed:
                await self.px4("pilot HOLD")  # a person hands over in hold, or the engagement is refused
            await self.engage()
        await self.in_state(*(states or IN_OFFBOARD))

    async def let_go(self) -> None:
        """A person ends what the service is about."""
        assert (await self.command("abort"))["ok"]
        await self.in_state("latched", timeout_s=3.0)

    async def stand(self) -> None:
        """Have the vehicle stand disarmed on the ground, and the service at rest."""
        await self._run()
        if (await self.until(lambda status: True))["state"] not in ("idle", "latched"):
            await self.let_go()
        if not (await self.px4()).landed:
            await self.px4("pilot LAND")
        while (await self.px4()).armed:  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.1)
        await self.px4("pilot HOLD")

    async def _run(self) -> None:
        """A test may have left it ended."""
        if self.has_ended:
            await self.restart()

    @property
    def has_ended(self) -> bool:
        """Whether the service has."""
        return self.cast.ended().startswith("uav ")

    async def restart(self) -> None:
        """Start the service again, after it has ended."""
        await self.cast.start_uav()
        await self.until(lambda status: True, 30.0)

    async def kill(self) -> int:
        """kill -9 of the service; when that was, on the monotonic clock."""
        killed_ns = asyncio.get_running_loop().time()
        os.kill(self.cast.pid("uav"), signal.SIGKILL)
        await self.cast.wait("uav")
        return round(killed_ns * 1e9)

    @staticmethod
    def _send(path: Path, text: str) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            sock.sendto(text.encode(), str(path))


@asynccontextmanager
async def flying(
    out: Path,
    real_url: str = "",
    autopilot: dict[str, Any] | None = None,
    page: PageConfig | None = None,
    px4_options: tuple[str, ...] = (),
    foxglove: FoxgloveConfig | None = None,
    beside: bool = False,
    **mission: Any,
) -> AsyncIterator[Flying]:
    """A cast whose camera is a child of the service. `autopilot` and `mission` replace values of those sections of the
    configuration; with `page` it has one; with what stands `beside` it a team, and tells TAK on loopback.

    With `real_url` an autopilot is there already, and whoever asks for it tells the world where its vehicle truly is.
    """
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        stage = set_stage(Path(name), out, SEED, use_netlink=False)
        tak = TakConfig(enabled=beside, address="127.0.0.1", port=_free_udp_port(), period_s=0.5)
        team, live = TeamConfig(enabled=beside), foxglove or stage.uav.foxglove
        stage = replace(stage, uav=replace(stage.uav, foxglove=live, team=team, tak=tak))
        stage = _with_camera(stage, mission, real_url, autopilot or {}, page=page)
        with (
            bind_datagram_socket(stage.truth_socket) as truths,
            bind_datagram_socket(stage.directory / "px4-reply.sock") as reports,
        ):
            control = str(stage.directory / "px4.sock")
            options = ("--control", control, *px4_options)
            async with Cast(stage, out, *options, service=_SERVICE, has_mock=not real_url) as cast:
                flight = Flying(stage, cast, out, reports)
                listener = asyncio.create_task(listen(truths, flight.truths))
                try:
                    yield flight
                finally:
                    listener.cancel()


def _free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert isinstance(port, int)
    return port


def _with_camera(
    stage: Stage, mission: dict[str, Any], real_url: str, autopilot: dict[str, Any], *, page: PageConfig | None
) -> Stage:
    directory = stage.directory
    lens = directory / "camera.sock"
    pose_socket = stage.uav.path(stage.uav.pose.socket)
    paths = ("--from", str(lens), "--to", str(pose_socket), "--orders", str(directory / "camera-orders.sock"))
    reader = [sys.executable, "-m", "tests.faults.pose_relay", *paths]
    uav = replace(
        stage.uav,
        pose=replace(stage.uav.pose, reader_command=reader),
        mission=replace(stage.uav.mission, **{"hold_limit_s": HOLD_LIMIT_S} | mission),
        page=page or stage.uav.page,
    )
    assert uav.autopilot is not None
    uav = replace(uav, autopilot=AutopilotConfig(real_url or uav.autopilot.url, **autopilot))
    save_config(uav, directory / f"{uav.name}.yaml")
    scenario = replace(stage.scenario, uav=replace(stage.scenario.uav, pose_socket=str(lens)))
    (directory / "scenario.json").write_bytes(encode_scenario(scenario))
    return replace(stage, uav=uav, scenario=scenario)
