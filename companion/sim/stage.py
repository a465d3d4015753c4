"""The processes of the demo: where their files and ports are, how they start, how they end."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import math
import os
import secrets
import signal
import socket
import sys
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, cast

from companion.config.document import read_document
from companion.config.file import config_of, save_config
from companion.config.schema import AutopilotConfig, Config
from companion.errors import CompanionError
from companion.host.child import die_with_parent
from companion.shipped.files import shipped_text
from companion.sim.scenario import CsiEndpoint, RobotScenario, Scenario, ax210_radio, encode_scenario
from companion.sim.scenes import drives, fence_in, set_in
from csi_bridge.feitcsi.netlink import vendor_events_available
from csi_bridge.netlink import connector_available

WORLD: Final = "world"
"""The process that comes first; what it says is in WORLD.txt."""
_STOP_S: Final = 5.0
_PX4_PARAMETERS: Final = ("COM_OBL_RC_ACT=5", "COM_RC_OVERRIDE=3", "RTL_RETURN_ALT=2")
"""What the preflight requires; PX4's own defaults are others. The lowest ceiling of the scenes is at 3.5 m."""
_GPS_DENIED: Final = ("SYS_HAS_GPS=0", "EKF2_GPS_CTRL=0", "EKF2_HGT_REF=3", "EKF2_EV_CTRL=11")
_VIO_HZ: Final = 50.0
_MAST_M: Final = 0.45
_ROVER_M_S2: Final = 0.4
_ROBOTS: Final = 2
_AX_WIDTH_MHZ: Final = 80
_AX_GAINS_DB: Final = (0.0, -3.0, -99.0)
_AX_BUDGET_BYTES_S: Final = 10_000.0
_AX_RATE_HZ: Final = 100.0
"""What a ping and its answer from user space leave room for, and a third less to simulate."""
_TRANSPORTS: Final = {"5300": "netlink", "ax210": "nl80211"}

Card = Literal["5300", "ax210"]
Transport = Literal["netlink", "nl80211", "unix"]
_CONNECTORS: Final = (26, 27, *range(28, 33), *range(10, 26))  # the driver's own first, as on a vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Where everything of one demo run is. `transport` is netlink where permitted, else unix with the reason why."""

    directory: Path
    uav: Config
    beacon: Config
    scenario: Scenario
    mavlink_port: int
    transport: str
    transport_reason: str
    claims: tuple[socket.socket, ...]
    """Hold the connector indices for this run: two runs in one group would hear each other's radio."""

    @property
    def truth_socket(self) -> Path:
        return Path(self.scenario.truth_out)

    @property
    def control_socket(self) -> Path:
        return self.uav.path(self.uav.control_socket)


def set_stage(
    directory: Path,
    out: Path,
    seed: int,
    use_netlink: bool = True,
    gps: bool = True,
    scene: str | None = None,
    card: Card = "5300",
) -> Stage:
    """Keys, free ports, configurations and the scenario for one run, written below `directory` (short: socket paths
    have a limit). Logs go to `out`. Without `gps` the vehicle flies by the companion's poses. `scene` is one of
    `companion.sim.scenes`, None the room of the scenario's defaults. Cards are Intel 5300s, or AX210s whose packets are
    80 MHz wide."""
    is_available = connector_available if card == "5300" else vendor_events_available
    reason = (is_available() or "") if use_netlink else "it was asked for"
    transport = "unix" if reason else _TRANSPORTS[card]
    claims = {} if transport == "unix" else claim_connectors(_ROBOTS)
    mavlink_port, neighbour_port = free_udp_port("127.0.0.1"), free_udp_port("127.255.255.255")
    uav = _shipped("demo-uav.yaml")
    beacon = _shipped("demo-beacon.yaml")
    if scene is not None and drives(scene):
        uav = _on_wheels(uav)
    uav = dataclasses.replace(
        _placed(uav, directory / "uav", transport, neighbour_port, log=out / "log.mcap", connectors=claims),
        autopilot=AutopilotConfig(f"udpin://127.0.0.1:{mavlink_port}", gps=gps, forward_vio_hz=0.0 if gps else _VIO_HZ),
    )
    beacon = _placed(
        beacon, directory / "beacon", transport, neighbour_port, log=out / "beacon.mcap", connectors=claims
    )
    scenario = _scenario(uav, beacon, directory, seed)
    if card == "ax210":
        scenario = _with_ax_cards(scenario)
        # A channel of 80 MHz is sent as 26 numbers, where one of 20 MHz is eight.
        beacon = dataclasses.replace(
            beacon, neighbours=dataclasses.replace(beacon.neighbours, budget_bytes_s=_AX_BUDGET_BYTES_S)
        )
    if scene is not None:
        scenario = set_in(scenario, scene)
        uav = dataclasses.replace(uav, gate=fence_in(scenario.radio, uav.gate))
    uav_key, beacon_key = secrets.token_bytes(32), secrets.token_bytes(32)
    for config, own_key, peer_key in ((uav, uav_key, beacon_key), (beacon, beacon_key, uav_key)):
        config.path("").mkdir()
        save_config(config, directory / f"{config.name}.yaml")
        _write_key(config.path(config.neighbours.key_file), own_key)
        _write_key(config.path(config.peers[0].key_file), peer_key)
    (directory / "scenario.json").write_bytes(encode_scenario(scenario))
    return Stage(
        directory=directory,
        uav=uav,
        beacon=beacon,
        scenario=scenario,
        mavlink_port=mavlink_port,
        transport=transport,
        transport_reason=reason,
        claims=tuple(claims.values()),
    )


class Cast:
    """The running processes. Used as an async context: at its end all of them have ended, whatever happened."""

    def __init__(
        self,
        stage: Stage,
        out: Path,
        *px4_options: str,
        service: Sequence[str] = ("companion", "run"),
        has_mock: bool = True,
    ) -> None:
        """`service` is the module that flies, with its first arguments; without the mock a real autopilot is there."""
        self._service = service
        self._has_mock = has_mock
        self._stage = stage
        self._out = out
        parameters = (*_PX4_PARAMETERS, *(_GPS_DENIED if stage.uav.flies_by_poses else ()))
        self._px4_options = (
            "--vehicle",
            stage.uav.mission.vehicle,
            *(word for one in parameters for word in ("--param", one)),
            *px4_options,
        )
        self._processes: dict[str, asyncio.subprocess.Process] = {}

    async def __aenter__(self) -> Cast:
        try:
            return await self._enter()
        except BaseException:
            await self.__aexit__()  # not called by itself when entering fails
            raise

    async def _enter(self) -> Cast:
        stage = self._stage
        directory = stage.directory
        await self._start(WORLD, "companion.sim.world", "--scenario", directory / "scenario.json")
        if self._has_mock:
            await self._start_mock()
        await self._start("beacon", "companion", "run", "--config", directory / "beacon.yaml")
        await self.start_uav()
        return self

    async def _start_mock(self) -> None:
        stage = self._stage
        await self._start(
            "px4", "companion.sim.px4.autopilot", "--connect", f"127.0.0.1:{stage.mavlink_port}",
            "--truth", stage.scenario.truth_in, "--seed", stage.scenario.seed, *self._px4_options,
        )  # fmt: skip

    async def start_uav(self) -> None:
        """Start the flying robot's service, or start it again after it has ended."""
        await self._start("uav", *self._service, "--config", self._stage.directory / "uav.yaml")

    async def wait(self, name: str) -> int:
        """Until one of them has ended by itself; its exit code."""
        return await self._processes[name].wait()

    async def __aexit__(self, *_: object) -> None:
        # The services go first, so that the vehicle is left in Hold while its autopilot is still there to take it.
        for names in (("uav", "beacon"), ("px4", WORLD)):
            await asyncio.gather(*(self._stop(name) for name in names if name in self._processes))

    def pid(self, name: str) -> int:
        """Process id of one of world, px4, beacon, uav."""
        return self._processes[name].pid

    def ended(self) -> str:
        """Which process has ended although nobody asked it to, and where its log is; empty while all run."""
        for name, process in self._processes.items():
            if process.returncode is not None:
                return f"{name} ended with code {process.returncode}; see {self._out / name}.txt"
        return ""

    async def _start(self, name: str, module: str, *arguments: object) -> None:
        # The simulated hardware is niced: on a vehicle it takes no time from the service either.
        nice = ("nice", "-n", "5") if name in (WORLD, "px4") else ()
        with (self._out / f"{name}.txt").open("ab") as log:
            self._processes[name] = await asyncio.create_subprocess_exec(
                *nice, sys.executable, "-m", module, *map(str, arguments),
                stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log,
                start_new_session=True,  # an interrupt from the terminal reaches the demo, which ends them in order
                preexec_fn=die_with_parent,
            )  # fmt: skip

    async def _stop(self, name: str) -> None:
        process = self._processes[name]
        with contextlib.suppress(ProcessLookupError):
            process.send_signal(signal.SIGTERM)
        try:
            async with asyncio.timeout(_STOP_S):
                await process.wait()
        except TimeoutError:
            process.kill()
            await process.wait()


def claim_connectors(count: int, among: Iterable[int] = _CONNECTORS) -> dict[int, socket.socket]:
    """So many connector indices that no other run on this machine uses, each with the socket that says so.

    An abstract Unix socket is a lock that the kernel gives back whenever its process ends.
    """
    claims: dict[int, socket.socket] = {}
    for index in among:
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0wsr-companion-demo-connector-{index}")
        except OSError:
            claim.close()
            continue
        claims[index] = claim
        if len(claims) == count:
            return claims
    raise CompanionError("every netlink connector index is taken by another demo; wait until one has ended")


def _shipped(name: str) -> Config:
    document = read_document(shipped_text(f"configs/{name}"), name)
    assert isinstance(document, dict)
    return config_of(document, name)


def _placed(
    config: Config,
    directory: Path,
    transport: str,
    neighbour_port: int,
    *,
    log: Path,
    connectors: Collection[int],
) -> Config:
    """The configuration of the file with this run's directory, ports, transport and connector."""
    index = config.csi.connector_idx
    if connectors:
        index = sorted(connectors)[config.role == "beacon"]
    return dataclasses.replace(
        config,
        runtime_dir=str(directory),
        csi=dataclasses.replace(config.csi, source=cast(Transport, transport), connector_idx=index),
        neighbours=dataclasses.replace(config.neighbours, port=neighbour_port),
        recorder=dataclasses.replace(config.recorder, path=str(log.resolve())),
    )


def _on_wheels(config: Config) -> Config:
    """A rover in the place of the copter: its antenna on a mast, and turns that it can follow without a stop."""
    forward, left, _ = config.pose.antenna_m
    return dataclasses.replace(
        config,
        mission=dataclasses.replace(config.mission, vehicle="rover", acceleration_m_s2=_ROVER_M_S2),
        pose=dataclasses.replace(config.pose, antenna_m=(forward, left, _MAST_M)),
    )


def _scenario(uav: Config, beacon: Config, directory: Path, seed: int) -> Scenario:
    """The world these two configurations expect: their MACs, antennas, camera headings and sockets."""
    return Scenario(
        seed=seed,
        uav=_robot(uav, mac=beacon.peers[0].mac, oscillator_ppm=1.3, clock_offset_s=0.0),
        beacon=_robot(beacon, mac=uav.peers[0].mac, oscillator_ppm=-0.7, clock_offset_s=38.0),
        truth_in=str(directory / "truth-in.sock"),
        truth_out=str(directory / "truth-out.sock"),
    )


def _with_ax_cards(scenario: Scenario) -> Scenario:
    """Both chains hear, the first one best."""
    uav, beacon = (
        dataclasses.replace(robot, antenna_gain_db=_AX_GAINS_DB) for robot in (scenario.uav, scenario.beacon)
    )
    radio = dataclasses.replace(ax210_radio(scenario.radio, _AX_WIDTH_MHZ), exchange_rate_hz=_AX_RATE_HZ)
    return dataclasses.replace(scenario, uav=uav, beacon=beacon, radio=radio)


def _robot(config: Config, mac: str, oscillator_ppm: float, clock_offset_s: float) -> RobotScenario:
    forward, left, up = config.pose.antenna_m
    csi = config.csi
    return RobotScenario(
        mac=mac,
        csi=CsiEndpoint(csi.source, csi.connector_idx, str(config.path(csi.socket))),
        pose_socket=str(config.path(config.pose.socket)),
        antennas_m=((forward, left, up), (forward, left + 0.06, up), (forward, left - 0.06, up)),
        oscillator_ppm=oscillator_ppm,
        clock_offset_s=clock_offset_s,
        frame_yaw_rad=math.radians(config.pose.north_yaw_deg),
    )


def _write_key(path: Path, key: bytes) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(key)


def free_udp_port(address: str) -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((address, 0))
        port = probe.getsockname()[1]
    assert isinstance(port, int)
    return port
