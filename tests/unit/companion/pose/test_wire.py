"""The datagram of a pose, byte for byte."""

from __future__ import annotations

import math
import struct

import pytest

from companion.pose.wire import DATAGRAM_BYTES, PoseFrame, PoseWireError, RawPose, decode, encode

_POSE = RawPose(
    t_mono_ns=1_234_567_890_123,
    position_m=(1.0, -2.0, 1e-9),
    quaternion_wxyz=(0.5, -0.5, 0.5, -0.5),
    velocity_m_s=(0.25, 0.0, -3.0),
    confidence=3,
    frame=PoseFrame.T265,
    session=513,
)


def test_the_layout_is_the_documented_one() -> None:
    data = encode(_POSE)
    assert len(data) == DATAGRAM_BYTES == 68
    assert data[:4] == b"PSE1"
    assert struct.unpack_from("<Q", data, 4) == (_POSE.t_mono_ns,)
    assert struct.unpack_from("<3d", data, 12) == _POSE.position_m
    assert struct.unpack_from("<4f", data, 36) == _POSE.quaternion_wxyz
    assert struct.unpack_from("<3f", data, 52) == _POSE.velocity_m_s
    assert struct.unpack_from("<BBH", data, 64) == (3, 1, 513)


@pytest.mark.parametrize("pose", [_POSE, _POSE._replace(frame=PoseFrame.ENU, confidence=0, session=0)])
def test_a_pose_comes_back(pose: RawPose) -> None:
    assert decode(encode(pose)) == pose


def test_a_lost_tracker_may_say_nan() -> None:
    assert math.isnan(decode(encode(_POSE._replace(position_m=(math.nan, 0.0, 0.0)))).position_m[0])


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (b"", "0 bytes, expected 68"),
        (encode(_POSE) + b"\0", "69 bytes, expected 68"),
        (b"PSE2" + encode(_POSE)[4:], "magic b'PSE2', expected b'PSE1'"),
        (encode(_POSE)[:64] + b"\x04" + encode(_POSE)[65:], "confidence 4, expected 0..3"),
        (encode(_POSE)[:65] + b"\x03" + encode(_POSE)[66:], r"frame 3, expected one of \[1, 2\]"),
    ],
)
def test_anything_else_is_named(data: bytes, named: str) -> None:
    with pytest.raises(PoseWireError, match=named):
        decode(data)
