"""The table of hand moves against the whole chain from the camera's axes, and the command that walks through it."""

from __future__ import annotations

import asyncio
import math
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from companion.commands.check_axes import check_axes
from companion.config.file import load_config, save_config
from companion.core.messages import Pose
from companion.errors import CompanionError
from companion.host.control_socket import ControlServer
from companion.pose import wire
from companion.pose.hand_moves import MOVES, HandMove, expected_enu_m, judge
from companion.pose.source import BodyFrame
from tests.paths import CONFIGS
from wsr.geometry import quaternion_from_yaw, quaternion_multiply

_CONFIG = CONFIGS / "demo-uav.yaml"
# In the camera's own axes (X right, Y up, Z back) as it starts: how it moves and turns in each hand move.
_CAMERA = {
    "forward": ((0.0, 0.0, -1.0), 0.0),
    "left": ((-1.0, 0.0, 0.0), 0.0),
    "up": ((0.0, 1.0, 0.0), 0.0),
    "turn left": ((0.0, 0.0, 0.0), math.pi / 2),
}


def _camera_pose(name: str, north_deg: float, mirrored: bool = False) -> tuple[Pose, Pose]:
    (x, y, z), turn_rad = _CAMERA[name]
    frame = BodyFrame(math.radians(north_deg))
    about_y = (math.cos(turn_rad / 2), 0.0, math.sin(turn_rad / 2), 0.0)
    sign = -1.0 if mirrored else 1.0
    at = wire.RawPose(1, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 3, wire.PoseFrame.T265)
    then = replace(at, t_mono_ns=2, position_m=(sign * x, sign * y, sign * z), quaternion_wxyz=about_y)
    return frame.pose(at), frame.pose(then)


@pytest.mark.parametrize("north_deg", [0.0, 40.0, -130.0])
@pytest.mark.parametrize("move", MOVES, ids=lambda move: move.name)
def test_each_move_of_the_camera_is_found_right(move: HandMove, north_deg: float) -> None:
    result = judge(move, *_camera_pose(move.name, north_deg), 1.0)
    assert result.problem == ""
    assert result.moved_enu_m == pytest.approx(result.expected_enu_m, abs=1e-9)


@pytest.mark.parametrize("move", MOVES[:3], ids=lambda move: move.name)
def test_a_mirrored_axis_is_found(move: HandMove) -> None:
    assert "180 deg away" in judge(move, *_camera_pose(move.name, 10.0, mirrored=True), 1.0).problem


def test_what_a_person_does_wrong_is_told_apart() -> None:
    before, after = _camera_pose("forward", 0.0)
    assert "it moved 1.00 m, expected 2.00" in judge(MOVES[0], before, after, 2.0).problem
    w, x, y, z = quaternion_from_yaw(math.radians(130)).tolist()
    assert (
        "turned by +40 deg meanwhile"
        in judge(MOVES[0], before, replace(after, q_enu_from_body=(w, x, y, z)), 1.0).problem
    )
    assert "turned by +0 deg, expected +90" in judge(MOVES[3], before, before, 1.0).problem
    pitch = (math.cos(math.radians(20)), 0.0, math.sin(math.radians(20)), 0.0)
    w, x, y, z = quaternion_multiply(before.q_enu_from_body, pitch).tolist()
    assert "up axis is 40 deg" in judge(MOVES[0], before, replace(after, q_enu_from_body=(w, x, y, z)), 1.0).problem


def test_the_table_of_moves() -> None:
    """Nose to the North: forward is North, left is West. docs/vehicle.md has it, generated."""
    table = {move.name: expected_enu_m(move, math.pi / 2, 1.0) for move in MOVES}
    assert table["forward"] == pytest.approx((0, 1, 0)) and table["left"] == pytest.approx((-1, 0, 0), abs=1e-12)
    assert table["up"] == pytest.approx((0, 0, 1)) and table["turn left"] == (0, 0, 0)


def _wait_for(path: Path) -> None:
    """Until somebody listens there."""
    deadline_s = time.monotonic() + 10.0
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        while probe.connect_ex(str(path)) != 0:
            assert time.monotonic() < deadline_s, f"nobody listens on {path}"
            time.sleep(0.01)


@contextmanager
def _service(folder: Path, poses: list[Pose], heading_rad: float | None) -> Iterator[Path]:
    """A control socket that answers `pose` with one pose after the other; its config file."""
    config = replace(load_config(_CONFIG), runtime_dir=str(folder))
    save_config(config, folder / "uav.yaml")
    waiting = iter([poses[0], *poses])  # the first is the command's own look at whether there are any

    async def answer(command: str) -> dict[str, Any]:
        assert command == "pose"
        pose = next(waiting, poses[-1])
        return {"ok": True, **asdict(pose), "autopilot_yaw_rad": heading_rad}

    loop = asyncio.new_event_loop()
    server = ControlServer(config.path(config.control_socket), answer)
    task = loop.create_task(server.run())
    thread = threading.Thread(target=lambda: loop.run_until_complete(asyncio.wait([task])))
    thread.start()
    try:
        _wait_for(config.path(config.control_socket))
        yield folder / "uav.yaml"
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join()
        loop.close()


def _walk(folder: Path, poses: list[Pose], heading_rad: float | None) -> tuple[str, BaseException | None]:
    with _service(folder, poses, heading_rad) as config:
        result = CliRunner().invoke(
            check_axes, ["--config", str(config), "--json", str(folder / "r.json")], input="\n" * 8
        )
    return result.output, result.exception


def test_the_command_walks_through_all_moves(tmp_path: Path) -> None:
    poses = [pose for move in MOVES for pose in _camera_pose(move.name, 40.0)]
    output, error = _walk(tmp_path, poses, math.radians(90 + 40 + 90 + 3))
    assert error is None, output
    assert output.count(": right") == 5 and "north: the poses' heading is -3.0 deg from the autopilot's" in output
    assert '"north_error_deg": -3.0' in (tmp_path / "r.json").read_text()


def test_without_a_service_nobody_is_asked_to_carry_anything(tmp_path: Path) -> None:
    save_config(replace(load_config(_CONFIG), runtime_dir=str(tmp_path)), tmp_path / "uav.yaml")
    result = CliRunner().invoke(check_axes, ["--config", str(tmp_path / "uav.yaml")], input="\n" * 8)
    assert isinstance(result.exception, CompanionError) and "no service is running there" in str(result.exception)
    assert result.output == ""


def test_the_command_names_what_is_wrong(tmp_path: Path) -> None:
    poses = [pose for move in MOVES for pose in _camera_pose(move.name, 0.0, mirrored=move.name == "left")]
    output, error = _walk(tmp_path, poses, 0.0)
    assert isinstance(error, CompanionError) and str(error).startswith("the axes are wrong: left, north;")
    assert "180 deg away" in output and "set pose.north_yaw_deg anew" in output
