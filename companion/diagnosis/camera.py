"""What gives poses: the camera on its bus, its node, its reader's environment, and the poses themselves."""

from __future__ import annotations

import asyncio
import contextlib
import grp
import stat
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from companion.config.schema import Config
from companion.core.clock import MonotonicClock
from companion.core.messages import Pose
from companion.errors import CompanionError
from companion.pose.opening import open_poses
from companion.radio.checks import Check

_T265: Final = {("8087", "0b37"): "an Intel T265", ("03e7", "2150"): "an Intel T265 before its firmware"}
_USB: Final = Path("sys/bus/usb/devices")
_READER: Final = Path("opt/companion/current/t265/bin/python")
_ENABLED: Final = Path("etc/systemd/system/multi-user.target.wants/companion-t265.service")
_GROUP: Final = "plugdev"
_IMPORT: Final = (
    "import companion.pose.t265_reader, pyrealsense2, importlib.metadata as m; print(m.version('pyrealsense2'))"
)
_TIMEOUT_S: Final = 30


async def camera_checks(config: Config, seconds: float, root: Path, status: dict[str, Any] | None) -> list[Check]:
    """`status` is what a running service says of itself: it holds the source of poses then."""
    source = config.pose.source
    if source == "px4":
        return [Check("poses", None, "of the autopilot's own odometry", "companion doctor autopilot")]
    checks = list(_camera(config, root)) if source == "socket" else []
    if status is not None:
        checks.append(_of_service(status))
    elif any(check.name == "camera" and check.ok is False for check in checks):
        checks.append(Check("poses", None, "not listened to: there is no camera"))
    else:
        checks += await _listen(config, seconds)
    return checks


def _camera(config: Config, root: Path) -> Iterator[Check]:
    found = list(_on_the_bus(root))
    if config.pose.reader_command and (root / _ENABLED).is_symlink():
        remedy = "systemctl disable --now companion-t265, or take pose.reader_command out"
        yield Check("reader", False, "two of them: pose.reader_command and companion-t265.service", remedy)
    elif config.pose.reader_command:
        yield Check("reader", None, f"the service's own: {config.pose.reader_command[0]}")
    else:
        yield _reader(root)
    if not found:
        remedy = "plug it into USB 3; after a warm reboot unplug it and plug it in again"
        yield Check("camera", False, "no Intel T265 (8087:0b37, or 03e7:2150 before its firmware)", remedy)
        return
    for name, node in found:
        yield Check("camera", True, f"{name}, {node}")
        yield _node(node)


def _on_the_bus(root: Path) -> Iterator[tuple[str, Path]]:
    """What it is, and its node below /dev."""
    for device in sorted((root / _USB).glob("*")):
        try:
            ids = ((device / "idVendor").read_text().strip(), (device / "idProduct").read_text().strip())
            bus, number = (int((device / name).read_text()) for name in ("busnum", "devnum"))
        except (OSError, ValueError):
            continue
        if ids in _T265:
            yield _T265[ids], root / f"dev/bus/usb/{bus:03d}/{number:03d}"


def _node(node: Path) -> Check:
    """The service's user reaches it as a member of plugdev, by the udev rule."""
    try:
        found = node.stat()
    except OSError as error:
        return Check("camera's node", False, f"{node}: {error.strerror}", "unplug it and plug it in again")
    with contextlib.suppress(KeyError):
        if grp.getgrgid(found.st_gid).gr_name == _GROUP and found.st_mode & stat.S_IWGRP:
            return Check("camera's node", True, f"{node}, of group {_GROUP}")
    if found.st_mode & stat.S_IWOTH:
        return Check("camera's node", True, f"{node}, anybody's")
    return Check("camera's node", False, f"{node}: not of group {_GROUP}",
                 "udevadm control --reload; udevadm trigger (60-companion-t265.rules)")  # fmt: skip


def _reader(root: Path) -> Check:
    """Whether its own CPython 3.10 has the last librealsense with T265 support."""
    python = root / _READER
    if not python.exists():
        remedy = "make install INSTALL_PYTHON310=PATH; docs/install.md says where a CPython 3.10 comes from"
        return Check("reader", False, f"{python} is not there", remedy)
    try:
        done = subprocess.run([python, "-c", _IMPORT], capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return Check("reader", False, f"{python}: {error}", "make install builds it anew")
    said = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()[-1:]
    return Check("reader", done.returncode == 0, " ".join([f"{python.name},", "pyrealsense2", *said]),
                 "" if done.returncode == 0 else "apt install libusb-1.0-0")  # fmt: skip


async def _listen(config: Config, seconds: float) -> list[Check]:
    poses: list[Pose] = []
    try:
        source = open_poses(config, MonotonicClock(), poses.append)
    except CompanionError as error:
        return [Check("poses", False, str(error))]
    task = asyncio.create_task(source.run())
    try:
        await asyncio.wait([task], timeout=seconds)
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError, CompanionError):
            await task
        source.close()
    return list(_of(poses, config, seconds))


def _of(poses: list[Pose], config: Config, seconds: float) -> Iterator[Check]:
    rate_hz = len(poses) / seconds
    ok = rate_hz >= config.pose.min_rate_hz
    found = f"{rate_hz:.0f} a second, at least {config.pose.min_rate_hz:g} wanted"
    yield Check("poses", ok, found, "" if ok else "is the reader running? systemctl status companion-t265")
    if poses:
        least = min(pose.confidence for pose in poses)
        sure = least >= config.pose.min_confidence
        remedy = "" if sure else "light and texture in its view; move it a little"
        yield Check("confidence", sure, f"{least} of 3, at least {config.pose.min_confidence} wanted", remedy)


def _of_service(status: dict[str, Any]) -> Check:
    age_s = status.get("health", {}).get("pose_age_s")
    if age_s is None:
        return Check("poses", False, "the running service has none", "systemctl status companion-t265")
    fresh = age_s < 1.0
    return Check(
        "poses", fresh, f"the running service's newest is {age_s:.2f} s old", "" if fresh else "is its reader running?"
    )
