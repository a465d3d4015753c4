"""What a configuration asks of its unit: raw frames where it pings, and nothing where it does not."""

from __future__ import annotations

import dataclasses

import pytest

from companion.config.file import load_config
from companion.config.schema import Config
from companion.config.unit_settings import drop_in, unit_of
from tests.paths import CONFIGS


@pytest.fixture
def uav() -> Config:
    return load_config(CONFIGS / "uav.yaml")


def test_the_example_needs_nothing_beside_its_unit(uav: Config) -> None:
    assert all(line.startswith("#") for line in drop_in(uav).splitlines())
    assert (unit_of(uav), unit_of(load_config(CONFIGS / "beacon.yaml"))) == (
        "companion.service",
        "companion-beacon.service",
    )


def test_raw_frames_are_for_who_pings(uav: Config) -> None:
    ping = dataclasses.replace(uav.ping, enabled=True)
    asked = drop_in(dataclasses.replace(uav, ping=ping)).splitlines()
    assert {"AmbientCapabilities=CAP_NET_RAW", "CapabilityBoundingSet=CAP_NET_RAW"} < set(asked)
    assert "RestrictAddressFamilies=AF_PACKET" in asked and "SupplementaryGroups=plugdev" not in asked


def test_a_reader_of_its_own_gets_the_camera(uav: Config) -> None:
    pose = dataclasses.replace(uav.pose, reader_command=["/bin/reader"])
    asked = drop_in(dataclasses.replace(uav, pose=pose)).splitlines()
    assert "DeviceAllow=char-usb_device rw" in asked and "PrivateDevices=no" not in asked
    assert "PrivateDevices=no" in drop_in(dataclasses.replace(uav, role="beacon", pose=pose)).splitlines()


def test_a_tag_camera_of_its_own_gets_the_video_devices(uav: Config) -> None:
    camera = dataclasses.replace(uav.tag_camera, enabled=True)
    asked = drop_in(dataclasses.replace(uav, tag_camera=camera)).splitlines()
    assert {"SupplementaryGroups=video", "DeviceAllow=char-video4linux rw"} < set(asked)


def test_a_log_elsewhere_may_be_written(uav: Config) -> None:
    recorder = dataclasses.replace(uav.recorder, path="/srv/flights/log.mcap")
    assert "ReadWritePaths=/srv/flights" in drop_in(dataclasses.replace(uav, recorder=recorder)).splitlines()
    recorder = dataclasses.replace(uav.recorder, path="/home/pilot/log.mcap")
    assert "ProtectHome=no" in drop_in(dataclasses.replace(uav, recorder=recorder)).splitlines()
