"""What is given to the service is not what it says: a configuration, a camera's clock, a motion capture's version."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.config.schema import NatNetConfig
from companion.core.messages import Pose
from companion.errors import ConfigError
from companion.pose.natnet import NatNetPoses
from companion.pose.t265_reader import DeviceClock
from tests.faults.figures import record
from tests.manual_clock import ManualClock
from tests.paths import CONFIGS
from tests.unit.companion.pose.natnet_frames import PLACE, T_S, VERSIONS, datagram, frame, server_info

_MS = 1_000_000


def test_fault_45_a_key_or_a_section_that_stands_twice_is_refused_with_both_lines(tmp_path: Path) -> None:
    """Each line of the shipped configurations that has a key, written once more at the end of its section."""
    tried = 0
    for shipped in (CONFIGS / "uav.yaml", CONFIGS / "demo-uav.yaml"):
        lines = shipped.read_text().splitlines()
        for number, line in enumerate(lines, 1):
            key = line.partition(":")[0].strip()
            if not key.replace("_", "").isalnum() or line.startswith((" ", "#")):
                continue
            path = tmp_path / "twice.yaml"
            path.write_text("\n".join([*lines, f"{key}: 1"]) + "\n")
            with pytest.raises(ConfigError) as refused:
                load_config(path)
            assert f"line {len(lines) + 1}: {key} is there twice, first in line {number}" in str(refused.value)
            assert refused.value.exit_code == 2
            tried += 1
    record(45, keys_and_sections=tried, refused_with_both_lines=tried)
    assert tried > 15


@pytest.mark.parametrize("step_ms", [-240.0, -20.0, 240.0])
def test_fault_46_a_camera_whose_clock_steps_is_right_again_within_a_second(step_ms: float) -> None:
    """Poses at 200 Hz, each half a millisecond to three on its way, their stamps by a clock that NTP steps."""
    chance, clock, off_ms, last_s = random.Random(1), DeviceClock(), 0.0, 0.0
    for number in range(1200):
        true_ms = 100_000 + 5 * number
        wall_ms = 1.7e12 + 5 * number + (step_ms if number >= 600 else 0.0)
        stamp_ns = clock.monotonic_ns(wall_ms, round((true_ms + chance.uniform(0.5, 3.0)) * _MS))
        error_ms = abs(stamp_ns / _MS - true_ms)
        if number >= 600 and error_ms > 3.1:
            off_ms, last_s = max(off_ms, error_ms), (number - 599) * 0.005
    record(46, right_again_after_s=last_s, off_meanwhile_ms=round(off_ms, 1))
    assert last_s <= 1.0


@pytest.mark.parametrize("version", VERSIONS, ids=lambda v: f"{v[0]}.{v[1]}")
def test_fault_47_each_natnet_version_gives_its_poses_and_no_other_numbers(version: tuple[int, int]) -> None:
    got: list[Pose] = []
    clock = ManualClock()
    source = NatNetPoses(NatNetConfig(body=7, up="z"), clock, got.append)
    try:
        source._take(server_info(version), 0)
        for number in range(100):
            source._take(datagram(7, frame(version, t_s=T_S + 0.01 * number)), round(1e7 * number))
    finally:
        source.close()
    places = {pose.p_enu_m for pose in got}
    record(47, frames=100, poses=len(got), places=len(places))
    if version >= (2, 6):
        assert len(got) == 100 and places == {PLACE}
    else:
        assert not got, "not understood, and said so"
