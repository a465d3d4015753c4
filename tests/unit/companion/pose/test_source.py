"""The pose socket and its frames: a table of hand moves of the camera, and what a lost tracker sends."""

from __future__ import annotations

import asyncio
import contextlib
import math
import shutil
import socket
from pathlib import Path

import numpy as np
import pytest

from companion.core.messages import Pose
from companion.errors import CompanionError
from companion.pose import source as source_module
from companion.pose import wire
from companion.pose.source import BodyFrame, PoseSource
from wsr.geometry import rotate

LEVEL = (1.0, 0.0, 0.0, 0.0)


def raw(
    position: tuple[float, float, float],
    quaternion: tuple[float, float, float, float] = LEVEL,
    frame: wire.PoseFrame = wire.PoseFrame.T265,
) -> wire.RawPose:
    return wire.RawPose(
        t_mono_ns=123, position_m=position, quaternion_wxyz=quaternion, velocity_m_s=position, confidence=3, frame=frame
    )


@pytest.mark.parametrize(
    ("move", "north_yaw_deg", "expected"),
    [
        ((1.0, 0.0, 0.0), 0, (1.0, 0.0, 0.0)),  # to its right: East
        ((0.0, 1.0, 0.0), 0, (0.0, 0.0, 1.0)),  # up
        ((0.0, 0.0, -1.0), 0, (0.0, 1.0, 0.0)),  # forward: North
        ((0.0, 0.0, -1.0), 90, (-1.0, 0.0, 0.0)),  # forward, the camera having started towards West
        ((1.0, 0.0, 0.0), 90, (0.0, 1.0, 0.0)),
        ((0.0, 1.0, 0.0), 137, (0.0, 0.0, 1.0)),
    ],
)
def test_hand_moves(move: tuple[float, float, float], north_yaw_deg: float, expected: tuple[float, ...]) -> None:
    pose = BodyFrame(math.radians(north_yaw_deg)).pose(raw(move))
    np.testing.assert_allclose(pose.p_enu_m, expected, atol=1e-12)
    np.testing.assert_allclose(pose.v_enu_m_s, expected, atol=1e-12)


def test_the_nose_turns_left_when_the_camera_does_and_north_yaw_adds_to_it() -> None:
    half = math.radians(30) / 2
    turned_left = (math.cos(half), 0.0, math.sin(half), 0.0)  # about the camera's Y, which is up
    for north_yaw_deg in (0, 50):
        pose = BodyFrame(math.radians(north_yaw_deg)).pose(raw((0.0, 0.0, 0.0), turned_left))
        nose = rotate(np.array(pose.q_enu_from_body), np.array([1.0, 0.0, 0.0]))
        assert math.degrees(math.atan2(nose[1], nose[0])) == pytest.approx(90 + 30 + north_yaw_deg)
        up = rotate(np.array(pose.q_enu_from_body), np.array([0.0, 0.0, 1.0]))
        np.testing.assert_allclose(up, (0, 0, 1), atol=1e-12)


def test_enu_poses_pass_as_they_are() -> None:
    pose = BodyFrame(0.0).pose(raw((1.0, 2.0, 3.0), frame=wire.PoseFrame.ENU))
    assert pose.p_enu_m == (1.0, 2.0, 3.0)
    assert pose.q_enu_from_body == LEVEL


def test_the_socket_passes_good_poses_and_counts_the_rest(tmp_path: Path) -> None:
    got: list[Pose] = []
    path = tmp_path / "pose.sock"
    source = PoseSource(path, 0.0, got.append)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as camera:
        camera.connect(str(path))
        camera.send(wire.encode(raw((1.0, 2.0, 3.0))))
        camera.send(wire.encode(raw((math.nan, 2.0, 3.0))))
        camera.send(wire.encode(raw((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 0.0))))
        camera.send(b"PSE1 but short")
        camera.send(b"X" * wire.DATAGRAM_BYTES)
        source.drain()
    source.close()
    assert len(got) == 3, "poses that are not numbers are the health's to judge"
    assert (source.received, source.malformed, source.resets) == (3, 2, 0)
    assert not path.exists()


async def test_a_socket_that_was_taken_away_is_there_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(source_module, "_WATCH_S", 0.02)
    path, got = tmp_path / "run" / "pose.sock", list[Pose]()
    source = PoseSource(path, 0.0, got.append)
    task = asyncio.create_task(source.run())
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as camera:
        for number in range(3):
            await asyncio.sleep(0.05)
            camera.sendto(wire.encode(raw((1.0, 2.0, float(number)))), str(path))
            async with asyncio.timeout(10):
                while len(got) <= number:  # noqa: ASYNC110 - it has no event of its own
                    await asyncio.sleep(0.01)
                shutil.rmtree(path.parent)
                while not path.exists():  # noqa: ASYNC110
                    await asyncio.sleep(0.01)
    task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await task
    source.close()
    assert source.resets == 0


def test_a_reader_that_began_anew_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "pose.sock"
    source = PoseSource(path, 0.0, lambda _: None)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as camera:
        camera.connect(str(path))
        for session in (7, 7, 8, 8):
            camera.send(wire.encode(raw((1.0, 2.0, 3.0))._replace(session=session)))
        source.drain()
    source.close()
    assert source.resets == 1


def test_two_readers_at_once_are_told_in_one_line(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path, got = tmp_path / "pose.sock", list[Pose]()
    source = PoseSource(path, 0.0, got.append)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as camera:
        camera.connect(str(path))
        for number in range(500):
            for session, x in ((7, 1.0), (8, 2.0)):
                pose = raw((x, 0.0, 0.0))._replace(session=session, t_mono_ns=number * 5_000_000)
                camera.send(wire.encode(pose))
                source.drain()
        assert (source.resets, source.received, source.strangers) == (1, 501, 499)
        assert len({pose.p_enu_m for pose in got[1:]}) == 1
        (said,) = caplog.messages
        assert "two camera readers" in said
        # The one that is kept ends: the other is taken as one that begins anew.
        camera.send(wire.encode(raw((1.0, 0.0, 0.0))._replace(session=7, t_mono_ns=4_000_000_000)))
        source.drain()
    source.close()
    assert (source.resets, source.received) == (2, 502)


def test_a_socket_in_use_is_not_taken_but_a_stale_one_is(tmp_path: Path) -> None:
    path = tmp_path / "pose.sock"
    first = PoseSource(path, 0.0, lambda _: None)
    assert path.stat().st_mode & 0o077 == 0
    with pytest.raises(CompanionError, match="in use by another process"):
        PoseSource(path, 0.0, lambda _: None)
    first._socket.close()  # as after kill -9: the file stays
    PoseSource(path, 0.0, lambda _: None).close()
