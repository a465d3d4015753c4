"""Frames of each NatNet version, put together here field by field as Motive of that time streams them."""

from __future__ import annotations

import contextlib
import math
import struct
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.pose.natnet_frame import NatNetError, Version, body_in, message_of, protocol_version
from tests.unit.companion.pose.natnet_frames import (
    PLACE,
    T_S,
    TURN,
    VERSIONS,
    frame,
    rigid_body,
)


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
