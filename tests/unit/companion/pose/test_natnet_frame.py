"""Frames of each NatNet version, put together here field by field as Motive of that time streams them."""

from __future__ import annotations

import contextlib
import math
import random
import struct
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config.schema import NatNetConfig
from companion.core.clock import ManualClock
from companion.core.messages import Pose
from companion.pose.natnet import NatNetPoses
from companion.pose.natnet_frame import NatNetError, Version, body_in, message_of, protocol_version
from tests.paths import FIELD_CASES

VERSIONS = [(2, 5), (2, 6), (2, 7), (2, 8), (2, 9), (2, 10), (2, 11), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]
PLACE = (1.0, 2.0, 3.0)
TURN = (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))
T_S = 1234.5678


def section(version: Version, *things: bytes) -> bytes:
    body = b"".join(things)
    size = struct.pack("<i", len(body)) if version >= (4, 1) else b""
    return struct.pack("<i", len(things)) + size + body


def rigid_body(version: Version, number: int, place: tuple[float, ...] = PLACE, flags: int = 1) -> bytes:
    data = struct.pack("<i3f4f", number, *place, *TURN)
    if version < (3, 0):
        data += struct.pack("<i", 2) + bytes(2 * 12) + struct.pack("<2i", 7, 8) + struct.pack("<2f", 0.01, 0.01)
    data += struct.pack("<f", 0.001)
    return data + (struct.pack("<H", flags) if version >= (2, 6) else b"")


def frame(
    version: Version,
    names: tuple[bytes, ...] = (b"all", b"Drohne \xe4"),
    bodies: tuple[bytes, ...] | None = None,
    t_s: float = T_S,
    end_tag: bool = True,
) -> bytes:
    """The payload of a FRAMEOFDATA with something in every section that the version has."""
    data = struct.pack("<i", 99)
    data += section(version, *(name + b"\0" + struct.pack("<i3f", 1, 9, 9, 9) for name in names))
    data += section(version, struct.pack("<3f", 4, 5, 6))
    data += section(version, *(bodies or (rigid_body(version, 3, (7, 7, 7)), rigid_body(version, 7))))
    if version >= (2, 1):
        data += section(version, struct.pack("<ii", 1, 1) + rigid_body(version, 7, (8, 8, 8)))
    if version >= (4, 1):
        asset_body = struct.pack("<i3f4ffH", 7, 6, 6, 6, *TURN, 0.0, 1)
        data += section(version, struct.pack("<ii", 5, 1) + asset_body + struct.pack("<i", 1) + bytes(26))
    if version >= (2, 3):
        marker = struct.pack("<i3ff", 1, 1, 1, 1, 0.01)
        marker += struct.pack("<H", 2) if version >= (2, 6) else b""
        marker += struct.pack("<f", 0.5) if version >= (3, 0) else b""
        data += section(version, marker, marker)
    channels = struct.pack("<ii", 1, 2) + struct.pack("<i2f", 2, 1, 2) + struct.pack("<i1f", 1, 3)
    if version >= (2, 9):
        data += section(version, channels)
    if version >= (2, 11):
        data += section(version, channels)
    if version < (3, 0):
        data += struct.pack("<f", 0.004)  # software latency
    data += struct.pack("<II", 0x01020304, 5)
    data += struct.pack("<d" if version >= (2, 7) else "<f", t_s)
    if version >= (3, 0):
        data += struct.pack("<3Q", 10**9, 10**9, 10**9)
    if version >= (4, 1):
        data += struct.pack("<II", 1, 2)
    return data + struct.pack("<H", 0) + (struct.pack("<i", 0) if end_tag else b"")


def datagram(number: int, payload: bytes) -> bytes:
    return struct.pack("<HH", number, len(payload)) + payload


def server_info(version: Version) -> bytes:
    return datagram(1, b"Motive".ljust(256, b"\0") + bytes((3, 1, 0, 0)) + bytes((*version, 0, 0)))


@pytest.mark.parametrize("end_tag", [True, False])
@pytest.mark.parametrize("version", VERSIONS, ids=lambda v: f"{v[0]}.{v[1]}")
def test_the_body_and_its_time_are_found_in_frames_of_each_version(version: Version, end_tag: bool) -> None:
    body = body_in(frame(version, end_tag=end_tag), version, 7)
    assert body is not None
    assert body.position_m == PLACE
    assert body.quaternion_xyzw == pytest.approx(TURN)
    assert body.t_s == pytest.approx(T_S, abs=1e-9 if version >= (2, 7) else 1e-3)
    assert body.is_tracked
    assert body_in(frame(version), version, 12) is None
    lost = body_in(frame(version, bodies=(rigid_body(version, 7, flags=0),)), version, 7)
    assert lost is not None
    assert lost.is_tracked == (version < (2, 6))


@pytest.mark.parametrize("version", VERSIONS, ids=lambda v: f"{v[0]}.{v[1]}")
def test_frames_of_another_version_or_cut_anywhere_are_refused(version: Version) -> None:
    """A frame that is read as of another version gives no pose of other numbers."""
    whole = frame(version)
    for cut in range(len(whole) - 4):
        with pytest.raises(NatNetError):
            body_in(whole[:cut], version, 7)
    for other in VERSIONS:
        try:
            body = body_in(whole, other, 7)
        except NatNetError:
            continue
        assert body is not None
        assert body.position_m == PLACE
        assert body.t_s == pytest.approx(T_S, abs=1e-3)


@pytest.mark.parametrize(
    ("t_s", "place", "what"),
    [
        (-9e61, PLACE, "time stamp"),
        (math.nan, PLACE, "time stamp"),
        (1e12, PLACE, "time stamp"),
        (T_S, (1e9, 0, 0), "position"),
        (T_S, (math.nan, 0, 0), "position"),
    ],
)
def test_numbers_that_are_no_pose_never_leave(t_s: float, place: tuple[float, ...], what: str) -> None:
    payload = frame((3, 1), bodies=(rigid_body((3, 1), 7, place),), t_s=t_s)
    with pytest.raises(NatNetError, match=what):
        body_in(payload, (3, 1), 7)


@pytest.mark.parametrize("version", [(2, 6), (2, 10), (3, 1), (4, 1)])
def test_a_bogus_count_costs_neither_time_nor_memory(version: Version) -> None:
    whole = frame(version)
    tracemalloc.start()
    try:
        for at in range(len(whole) - 4):
            for count in (-1, 0x7FFFFFFF, 1_000_000):
                hurt = whole[:at] + struct.pack("<i", count) + whole[at + 4 :]
                with contextlib.suppress(NatNetError):
                    body_in(hurt, version, 7)
        assert tracemalloc.get_traced_memory()[1] < 5_000_000
    finally:
        tracemalloc.stop()


@given(st.binary(max_size=400), st.sampled_from(VERSIONS))
def test_any_bytes_give_a_body_or_the_one_error(data: bytes, version: Version) -> None:
    """Invariant: NatNetError and nothing else, whatever arrives."""
    for parse in (lambda: body_in(data, version, 0), lambda: message_of(data), lambda: protocol_version(data)):
        with contextlib.suppress(NatNetError):
            parse()


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
