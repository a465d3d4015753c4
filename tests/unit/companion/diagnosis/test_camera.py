"""The camera on its bus, and poses on a real socket."""

from __future__ import annotations

import asyncio
import dataclasses
import socket
import time
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.config.schema import Config
from companion.diagnosis.camera import camera_checks
from companion.pose import wire
from companion.radio.checks import Check
from tests.paths import CONFIGS, ROOT


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return dataclasses.replace(load_config(CONFIGS / "uav.yaml"), runtime_dir=str(tmp_path))


def _plug(root: Path) -> None:
    folder = root / "sys/bus/usb/devices/2-1"
    folder.mkdir(parents=True)
    for name, text in (("idVendor", "8087"), ("idProduct", "0b37"), ("busnum", "2"), ("devnum", "3")):
        (folder / name).write_text(f"{text}\n")


def _named(checks: list[Check]) -> dict[str, Check]:
    return {check.name: check for check in checks}


async def test_a_camera_that_is_not_there_is_named_by_its_ids(config: Config, tmp_path: Path) -> None:
    found = _named(await camera_checks(config, 0.5, tmp_path, None))
    assert found["camera"].ok is False and "8087:0b37" in found["camera"].found
    assert found["reader"].ok is False and "INSTALL_PYTHON310" in found["reader"].remedy
    assert found["poses"].ok is None


@pytest.mark.skipif(not (ROOT / ".venv-t265" / "t265.stamp").exists(), reason="no environment of the camera's reader")
async def test_the_readers_own_environment_is_tried(
    config: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import libusb_package

    monkeypatch.setenv("LD_PRELOAD", str(libusb_package.get_library_path()))  # whether or not the system has one
    monkeypatch.chdir(ROOT)  # where its own installation has the program
    (tmp_path / "opt/companion/current").mkdir(parents=True)
    (tmp_path / "opt/companion/current/t265").symlink_to(ROOT / ".venv-t265")
    reader = _named(await camera_checks(config, 0.5, tmp_path, None))["reader"]
    assert reader.ok and reader.found == "python, pyrealsense2 2.53.1.4623"


async def test_two_readers_for_one_socket_are_told(config: Config, tmp_path: Path) -> None:
    config = dataclasses.replace(config, pose=dataclasses.replace(config.pose, reader_command=["/bin/reader"]))
    assert _named(await camera_checks(config, 0.5, tmp_path, None))["reader"].ok is None
    wants = tmp_path / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir(parents=True)
    (wants / "companion-t265.service").symlink_to("/nowhere")
    assert _named(await camera_checks(config, 0.5, tmp_path, None))["reader"].ok is False


async def test_its_node_must_be_the_groups(config: Config, tmp_path: Path) -> None:
    _plug(tmp_path)
    node = tmp_path / "dev/bus/usb/002/003"
    assert _named(await camera_checks(config, 0.5, tmp_path, None))["camera's node"].ok is False
    node.parent.mkdir(parents=True)
    node.touch(mode=0o600)
    assert "60-companion-t265.rules" in _named(await camera_checks(config, 0.5, tmp_path, None))["camera's node"].remedy
    node.chmod(0o666)
    assert _named(await camera_checks(config, 0.5, tmp_path, None))["camera's node"].ok


async def test_poses_are_counted_and_their_confidence_told(config: Config, tmp_path: Path) -> None:
    _plug(tmp_path)
    looking = asyncio.create_task(camera_checks(config, 1.0, tmp_path, None))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as camera:
        while not looking.done():
            pose = wire.RawPose(
                t_mono_ns=time.monotonic_ns(),
                position_m=(0.0, 0.0, 0.0),
                quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
                velocity_m_s=(0.0, 0.0, 0.0),
                confidence=1,
                frame=wire.PoseFrame.T265,
                session=7,
            )
            try:
                camera.sendto(wire.encode(pose), str(tmp_path / "pose.sock"))
            except OSError:  # nobody listens yet, or no more
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.002)
    found = _named(await looking)
    assert found["poses"].ok, found["poses"]
    assert found["confidence"].ok is False and found["confidence"].found.startswith("1 of 3")


async def test_a_running_service_is_asked(config: Config, tmp_path: Path) -> None:
    for age_s, ok in ((0.01, True), (5.0, False), (None, False)):
        status = {"health": {"pose_age_s": age_s}}
        assert _named(await camera_checks(config, 0.5, tmp_path, status))["poses"].ok is ok


async def test_other_sources_have_no_camera(config: Config, tmp_path: Path) -> None:
    pose = dataclasses.replace(config.pose, source="px4")
    (check,) = await camera_checks(dataclasses.replace(config, pose=pose), 0.5, tmp_path, None)
    assert check.ok is None and check.remedy == "companion doctor autopilot"
