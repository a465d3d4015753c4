"""Every source of poses passes the same suite: the mission cannot tell them apart.

Each is driven through its real edge: datagrams on a Unix socket, ODOMETRY over MAVSDK from the mock autopilot, NatNet
frames on UDP, files. All tell the same motion: 1 m East, then 1 m North, then 1 m up, nose towards North.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import socket
import struct
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from companion.config.schema import NatNetConfig
from companion.core.clock import NS_PER_S, MonotonicClock
from companion.core.messages import Pose, Vector3
from companion.pose import wire
from companion.pose.autopilot import AutopilotPoses
from companion.pose.natnet import NatNetPoses
from companion.pose.port import Poses
from companion.pose.recording import FilePoses
from companion.pose.source import PoseSource
from wsr.geometry import rotate

_CLOCK = MonotonicClock()
_WAY: tuple[Vector3, ...] = ((0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (1.0, 1.0, 1.0), (1.0, 1.0, 2.0))
_HALF = math.sqrt(0.5)
_NOSE_NORTH = (_HALF, 0.0, 0.0, _HALF)


@dataclass
class Driven:
    """A source under test, what it delivered, and how a place is told to it."""

    source: Poses
    tell: Callable[[int, Vector3], None]
    got: list[Pose] = field(default_factory=list)
    tell_garbage: Callable[[], object] | None = None


def _wait_s(index: int) -> float:
    return 0.02 * index


@contextlib.asynccontextmanager
async def _t265(folder: Path) -> AsyncIterator[Driven]:
    path, got = folder / "pose.sock", list[Pose]()
    source = PoseSource(path, 0.0, got.append)
    camera = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)

    def tell(index: int, p: Vector3) -> None:
        east, north, up = p
        # The camera started looking North: its axes are X = East, Y = Up, Z = South, and it has not turned.
        raw = wire.RawPose(
            t_mono_ns=_CLOCK.now_ns(),
            position_m=(east, up, -north),
            quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
            velocity_m_s=(0.0, 0.0, 0.0),
            confidence=3,
            frame=wire.PoseFrame.T265,
        )
        camera.sendto(wire.encode(raw), str(path))

    with camera:
        yield Driven(source, tell, got, lambda: camera.sendto(b"nonsense", str(path)))


@contextlib.asynccontextmanager
async def _px4(folder: Path) -> AsyncIterator[Driven]:
    """ODOMETRY as PX4 sends it, through pymavlink's packing, MAVSDK's decoding and its thread."""
    from pymavlink.dialects.v20 import common as mavlink

    from companion.autopilot.mavsdk_edge import MavsdkAutopilot

    got = list[Pose]()
    source = AutopilotPoses(got.append)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def send(message: object) -> None:
        udp.sendto(message.pack(mav), ("127.0.0.1", port))  # type: ignore[attr-defined]

    def tell(index: int, p: Vector3) -> None:
        east, north, up = p
        zeros = [0.0] * 21
        send(mav.odometry_encode(index, 1, 12, north, east, -up, (1, 0, 0, 0), 0, 0, 0, 0, 0, 0, zeros, zeros, 0, 8))

    async def beat() -> None:
        while True:
            send(mav.heartbeat_encode(2, 12, 1, 4 << 16 | 3 << 24, 3))
            await asyncio.sleep(0.1)

    edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK, source.offer)
    beating = asyncio.create_task(beat())
    try:
        await edge.connect()
        yield Driven(source, tell, got)
    finally:
        beating.cancel()
        await edge.aclose()
        udp.close()


@contextlib.asynccontextmanager
async def _natnet(folder: Path) -> AsyncIterator[Driven]:
    """A server that answers the handshake and streams frames of NatNet 3.1, Y up, packed here by hand."""
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    server.bind(("127.0.0.1", 0))
    server.setblocking(False)
    got, peers = list[Pose](), list[tuple[str, int]]()
    source = NatNetPoses(NatNetConfig(port=server.getsockname()[1], body=7), _CLOCK, got.append)

    def answer() -> None:
        datagram, peer = server.recvfrom(1024)
        if struct.unpack_from("<H", datagram)[0] == 0:
            info = b"Motive".ljust(256, b"\0") + bytes((3, 1, 0, 0)) + bytes((3, 1, 0, 0))
            server.sendto(struct.pack("<HH", 1, len(info)) + info, peer)
            peers.append(peer)

    def tell(index: int, p: Vector3) -> None:
        east, north, up = p
        # Y up: X = East, Y = Up, Z = South. The nose (body X) looks North: a quarter turn about Up.
        mocap = (east, up, -north, 0.0, _HALF, 0.0, _HALF)
        other = struct.pack("<i3f4ffh", 3, *mocap, 0.0, 1)
        body = struct.pack("<i3f4ffh", 7, *mocap, 0.001, 1)
        counts = struct.pack("<iii", index, 0, 0)  # frame number, marker sets, unlabelled markers
        rest = struct.pack("<iiii", 0, 0, 0, 0)  # skeletons, labelled markers, force plates, devices
        suffix = struct.pack("<IIdQQQH", 0, 0, 10.0 + 0.02 * index, 0, 0, 0, 0)
        payload = counts + struct.pack("<i", 2) + other + body + rest + suffix
        server.sendto(struct.pack("<HH", 7, len(payload)) + payload, peers[-1])

    loop = asyncio.get_running_loop()
    loop.add_reader(server.fileno(), answer)
    running = asyncio.create_task(source.run())
    try:
        async with asyncio.timeout(5):
            while source._version is None:  # noqa: ASYNC110 - until the handshake is done
                await asyncio.sleep(0.01)
        garbage = struct.pack("<HH", 7, 6) + b"broken"
        yield Driven(source, tell, got, lambda: server.sendto(garbage, peers[-1]))
    finally:
        running.cancel()
        loop.remove_reader(server.fileno())
        server.close()


@contextlib.asynccontextmanager
async def _recorded(folder: Path, line: Callable[[float, Vector3], str], name: str) -> AsyncIterator[Driven]:
    path, got = folder / name, list[Pose]()
    path.write_text("# t and pose\n" + "".join(line(_wait_s(2 * i), p) for i, p in enumerate(_WAY)))
    yield Driven(FilePoses(path, _CLOCK, got.append), lambda index, p: None, got)


def _tum(folder: Path) -> contextlib.AbstractAsyncContextManager[Driven]:
    def line(t_s: float, p: Vector3) -> str:
        return f"{1000 + t_s:.3f} {p[0]} {p[1]} {p[2]} 0 0 {_HALF} {_HALF}\n"

    return _recorded(folder, line, "way.tum")


def _csv(folder: Path) -> contextlib.AbstractAsyncContextManager[Driven]:
    def line(t_s: float, p: Vector3) -> str:
        return f"1000,{round(t_s * 1e9)},{p[0]},{p[1]},{p[2]},0,0,{_HALF},{_HALF}\n"

    return _recorded(folder, line, "way.csv")


_SOURCES = {"t265": _t265, "px4": _px4, "natnet": _natnet, "tum": _tum, "csv": _csv}


@contextlib.asynccontextmanager
async def _running(driven: Driven) -> AsyncIterator[None]:
    running = asyncio.create_task(driven.source.run())
    await asyncio.sleep(0.05)
    try:
        yield
    finally:
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running


async def _told(driven: Driven, way: tuple[Vector3, ...] = _WAY) -> None:
    for index, place in enumerate(way):
        driven.tell(index, place)
        await asyncio.sleep(0.02)


@pytest.fixture(params=list(_SOURCES))
async def driven(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[Driven]:
    async with _SOURCES[request.param](tmp_path) as made:
        yield made
        made.source.close()
        made.source.close()  # harmless when repeated


async def _until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(5):
        while not condition():  # noqa: ASYNC110 - sources have no event of their own
            await asyncio.sleep(0.01)


async def test_the_same_motion_comes_out_in_east_north_up(driven: Driven) -> None:
    begin_ns = _CLOCK.now_ns() - NS_PER_S
    async with _running(driven):
        await _told(driven)
        await _until(lambda: len(driven.got) >= len(_WAY))
    poses = driven.got[-len(_WAY) :]
    moves = np.diff([pose.p_enu_m for pose in poses], axis=0)
    np.testing.assert_allclose(moves, [(1, 0, 0), (0, 1, 0), (0, 0, 1)], atol=1e-6)
    for pose in poses:
        np.testing.assert_allclose(rotate(np.array(pose.q_enu_from_body), np.array([1.0, 0, 0])), (0, 1, 0), atol=1e-6)
        assert pose.confidence == 3
    times = [pose.t_mono_ns for pose in poses]
    assert times == sorted(times) and begin_ns < times[0] <= times[-1] <= _CLOCK.now_ns()
    assert driven.source.received == len(driven.got) and driven.source.resets == 0


async def test_align_turns_the_world_from_the_left(driven: Driven) -> None:
    driven.source.align(math.pi / 2)
    async with _running(driven):
        await _told(driven, _WAY)
        await _until(lambda: len(driven.got) >= len(_WAY))
    moves = np.diff([pose.p_enu_m for pose in driven.got[-len(_WAY) :]], axis=0)
    np.testing.assert_allclose(moves, [(0, 1, 0), (-1, 0, 0), (0, 0, 1)], atol=1e-6)
    nose = rotate(np.array(driven.got[-1].q_enu_from_body), np.array([1.0, 0, 0]))
    np.testing.assert_allclose(nose, (-1, 0, 0), atol=1e-6)


@pytest.mark.parametrize("driven", ["t265", "natnet"], indirect=True)
async def test_garbage_is_counted_and_changes_nothing(driven: Driven) -> None:
    """What reaches the other sources was parsed before them (MAVSDK) or as a whole (files)."""
    assert driven.tell_garbage is not None
    async with _running(driven):
        driven.tell_garbage()
        await _told(driven)
        await _until(lambda: len(driven.got) >= len(_WAY))
    assert driven.source.malformed == 1
