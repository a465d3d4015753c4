"""`companion check-axes`: a person carries the vehicle, the command says whether the axes are right."""

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

from click.testing import CliRunner

from companion.commands.check_axes import check_axes
from companion.config.file import load_config, save_config
from companion.core.messages import Pose
from companion.errors import CompanionError
from companion.host.control_socket import ControlServer
from companion.pose.hand_moves import MOVES
from tests.paths import CONFIGS
from tests.unit.companion.pose.camera_moves import camera_pose

_CONFIG = CONFIGS / "demo-uav.yaml"


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

    async def answer(command: str, target: str | None = None) -> dict[str, Any]:
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
    poses = [pose for move in MOVES for pose in camera_pose(move.name, 40.0)]
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
    poses = [pose for move in MOVES for pose in camera_pose(move.name, 0.0, mirrored=move.name == "left")]
    output, error = _walk(tmp_path, poses, 0.0)
    assert isinstance(error, CompanionError) and str(error).startswith("the axes are wrong: left, north;")
    assert "180 deg away" in output and "set pose.north_yaw_deg anew" in output
