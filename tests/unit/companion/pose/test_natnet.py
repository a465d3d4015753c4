"""Poses of motion capture over NatNet."""

from __future__ import annotations

import contextlib
import math
import random
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.config.schema import NatNetConfig
from companion.core.clock import NS_PER_S, MonotonicClock
from companion.core.messages import Pose
from companion.pose.natnet import NatNetPoses
from companion.pose.natnet_frame import Version
from tests.manual_clock import ManualClock
from tests.paths import FIELD_CASES
from tests.unit.companion.pose.natnet_frames import T_S, VERSIONS, datagram, frame, rigid_body, server_info

_CLOCK = MonotonicClock()


async def test_a_body_that_motion_capture_lost_is_told_by_its_confidence(tmp_path: Path) -> None:
    got: list[Pose] = []
    source = NatNetPoses(NatNetConfig(body=7), _CLOCK, got.append)

    def frame(valid: int) -> bytes:
        body = struct.pack("<i3f4ffh", 7, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.0, valid)
        rest = struct.pack("<iiii", 0, 0, 0, 0) + struct.pack("<IIdQQQH", 0, 0, 1.0, 0, 0, 0, 0)
        payload = struct.pack("<iiii", 1, 0, 0, 1) + body + rest
        return struct.pack("<HH", 7, len(payload)) + payload

    source._take(struct.pack("<HH", 1, 264) + b"Motive".ljust(256, b"\0") + bytes((3, 1, 0, 0) * 2), 1)
    source._take(frame(0), 2)
    source._take(frame(1), 3)
    source.close()
    assert [pose.confidence for pose in got] == [0, 3]


def test_a_server_older_than_2_6_is_not_understood(tmp_path: Path) -> None:
    source = NatNetPoses(NatNetConfig(), _CLOCK, lambda _: None)
    source._take(struct.pack("<HH", 1, 264) + b"Motive".ljust(256, b"\0") + bytes((2, 5, 0, 0) * 2), 1)
    source.close()
    assert source._version is None


def test_flipped_bytes_give_no_implausible_pose() -> None:
    got: list[Pose] = []
    source = NatNetPoses(NatNetConfig(body=7), ManualClock(), got.append)
    chance = random.Random(5)
    for version in VERSIONS[1:]:
        source._take(server_info(version), 0)
        for number in range(300):
            payload = bytearray(frame(version, t_s=T_S + 0.01 * number))
            payload[chance.randrange(len(payload))] ^= 1 << chance.randrange(8)
            source._take(datagram(7, bytes(payload)), number)
    source.close()
    assert len(got) > 1000
    for pose in got:
        assert math.hypot(*pose.v_enu_m_s) < 50
        if pose.confidence:
            assert math.hypot(*pose.p_enu_m) < 2000
            assert math.hypot(*pose.q_enu_from_body) == pytest.approx(1, abs=0.1)


def test_a_version_that_does_not_tell_what_is_tracked_is_named(caplog: pytest.LogCaptureFixture) -> None:
    source = NatNetPoses(NatNetConfig(), ManualClock(), lambda _: None)
    for _ in range(3):
        source._take(server_info((2, 5)), 1)
    source.close()
    (said,) = caplog.messages
    assert "speaks NatNet 2.5" in said
    assert "2.6 or newer is needed" in said


@pytest.mark.skipif(not FIELD_CASES.is_dir(), reason="no field cases beside this clone")
def test_field_case_names_that_are_not_utf_8() -> None:
    got: list[Pose] = []
    source = NatNetPoses(NatNetConfig(body=7), ManualClock(), got.append)
    source._take(server_info((3, 1)), 0)
    for path in sorted((FIELD_CASES / "asset-name-latin1").glob("*.bin")):
        source._take(path.read_bytes(), len(got))
    source.close()
    assert (len(got), source.malformed) == (10, 0)


class _Motive:
    """A server on loopback that sends to whom it was greeted by, and knows nobody when it starts."""

    def __init__(self, version: Version, port: int = 0) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.version, self.sends, self.answers = version, True, True
        self.bodies: tuple[int, ...] = (3, 7)
        self.clients, self.greeted, self._number = set[Any](), 0, 0

    @property
    def port(self) -> int:
        return int(self.socket.getsockname()[1])

    def turn(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                asked, client = self.socket.recvfrom(1000)
                if struct.unpack_from("<H", asked)[0] == 0 and self.answers:
                    self.clients.add(client)
                    self.greeted += 1
                    self.socket.sendto(server_info(self.version), client)
        self._number += 1
        bodies = tuple(rigid_body(self.version, number) for number in self.bodies)
        payload = frame(self.version, bodies=bodies, t_s=T_S + 0.01 * self._number)
        for client in self.clients if self.sends else ():
            self.socket.sendto(datagram(7, payload), client)


async def _seconds(server: _Motive, source: NatNetPoses, count: int) -> None:
    """Without the loop's timers: a second is a greeting, a keep-alive, or what else is due, and five frames."""
    for _ in range(count):
        source._ask()
        for _ in range(5):
            server.turn()
            source._drain()


@pytest.fixture
def motive() -> Iterator[_Motive]:
    server = _Motive((4, 1))
    yield server
    server.socket.close()


async def test_a_server_that_changes_its_version_or_forgets_us_is_greeted_anew(
    motive: _Motive, caplog: pytest.LogCaptureFixture
) -> None:
    got: list[Pose] = []
    source = NatNetPoses(NatNetConfig(body=7, port=motive.port), _CLOCK, got.append)
    await _seconds(motive, source, 5)
    assert (motive.greeted, len(got)) == (1, 25), "from then on it is kept alive"
    for version in ((3, 1), (2, 11), (4, 2)):
        before, motive.version = len(got), version
        await _seconds(motive, source, 4)
        assert len(got) >= before + 10, version
        assert f"speaks NatNet {version[0]}.{version[1]} now" in caplog.text
    motive.clients.clear()  # it was restarted, and no packet of ours was refused meanwhile
    before = len(got)
    await _seconds(motive, source, 4)
    source.close()
    assert len(got) >= before + 10


async def test_who_does_not_answer_who_sends_nothing_and_whose_frames_lack_the_body_are_named(
    motive: _Motive, caplog: pytest.LogCaptureFixture
) -> None:
    clock = ManualClock()
    source = NatNetPoses(NatNetConfig(body=5, port=motive.port), clock, lambda _: None)
    motive.answers = motive.sends = False
    await _seconds(motive, source, 10)
    motive.answers = True
    await _seconds(motive, source, 10)
    motive.sends = True
    await _seconds(motive, source, 2)
    payload = frame((4, 1), bodies=(rigid_body((4, 1), 3), rigid_body((4, 1), 7)))
    for number in range(3):
        source._take(datagram(7, payload), time.monotonic_ns() + number * NS_PER_S)
    source.close()
    silent, unsent, other = caplog.messages
    assert silent.endswith("it does not answer; is Motive streaming?")
    assert unsent.endswith("answers and sends no frames: it must stream, as unicast")
    assert other == "pose.natnet.body 5 is in no frame of 127.0.0.1; in it are: 3, 7"


class _Server:
    """Motive at 100 Hz, whose body moves along its X at 1 m/s; what is taken when is a test's."""

    def __init__(self) -> None:
        self.got: list[Pose] = []
        self.source = NatNetPoses(NatNetConfig(body=7), ManualClock(), self.got.append)
        self.source._take(server_info((4, 1)), 0)

    def frame(self, t_ns: int, arrives_ns: int) -> None:
        payload = frame((4, 1), t_s=T_S + t_ns / NS_PER_S)
        self.source._take(datagram(7, payload), arrives_ns)

    def run(self, first: int, count: int, late_ns: int = 1_000_000) -> None:
        for number in range(first, first + count):
            self.frame(number * _FRAME_NS, number * _FRAME_NS + late_ns)


_FRAME_NS = 10_000_000


def test_frames_that_waited_together_hold_when_the_server_says() -> None:
    """A stall of the network, or of this program: 0.4 s of frames come at once."""
    server = _Server()
    server.run(0, 100)
    for number in range(100, 140):
        server.frame(number * _FRAME_NS, 140 * _FRAME_NS + number * 1000)
    server.source.close()
    times = [pose.t_mono_ns for pose in server.got]
    assert len(times) == 140
    for number in range(20, 140):
        assert times[number] == pytest.approx(number * _FRAME_NS + 1_000_000, abs=1_000_000)


def test_a_server_that_repeats_one_frame_tells_of_no_body(caplog: pytest.LogCaptureFixture) -> None:
    server = _Server()
    server.run(0, 50)
    for number in range(50, 150):
        server.frame(49 * _FRAME_NS, number * _FRAME_NS)
    assert len(server.got) <= 62, "a tenth of a second is no pause"
    assert [line for line in caplog.messages if "is Motive paused?" in line] == caplog.messages
    before = len(server.got)
    server.run(150, 10)
    server.source.close()
    assert len(server.got) == before + 10, "it plays again"


@pytest.mark.parametrize("step_ns", [-300_000_000, -5_000_000_000, 200_000_000, 7_000_000_000])
def test_a_servers_clock_that_steps_is_found_anew_within_a_second(step_ns: int) -> None:
    server = _Server()
    server.run(1000, 200)
    for number in range(1200, 1500):
        server.frame(number * _FRAME_NS + step_ns, number * _FRAME_NS + 1_000_000)
    server.source.close()
    for place, pose in enumerate(server.got[320:], start=1320):
        assert pose.t_mono_ns == pytest.approx(place * _FRAME_NS + 1_000_000, abs=2_000_000)
    for place, pose in enumerate(server.got, start=1000):
        assert pose.t_mono_ns <= place * _FRAME_NS + 1_000_000, "never later than it came"
