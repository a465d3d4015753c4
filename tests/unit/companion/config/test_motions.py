"""Speeds, rates and ranges: what a configuration asks for is what its gate lets be."""

from __future__ import annotations

import math
import random
from dataclasses import asdict, replace

import pytest

from companion.config import motions
from companion.config.motions import fastest
from companion.config.rules import config_errors
from companion.config.schema import Config
from companion.core.clock import NS_PER_S
from companion.guidance import approach, motion
from companion.guidance.approach import Approach
from companion.guidance.steering import Aim
from companion.safety.gate import GateLimits
from tests.unit.companion.config.test_rules import AUTOPILOT, UAV, changed


@pytest.mark.parametrize(
    ("config", "error"),
    [
        (changed("mission", speed_m_s=1.1), "mission.speed_m_s: above gate.max_speed_m_s"),
        (
            replace(
                changed("mission", speed_m_s=0.8, lateral_weave_m=0.4, vertical_weave_m=0.0, acceleration_m_s2=3.0),
                aperture=replace(UAV.aperture, length_m=3.0), gate=replace(UAV.gate, max_speed_m_s=0.9),
            ),
            "mission.lateral_weave_m: its turns take 0.96 m/s",
        ),
        (changed("gate", max_climb_m_s=0.4), "gate.max_climb_m_s: 0.4; expected 0.47 or more"),
        (
            replace(changed("mission", speed_m_s=1.5), gate=replace(UAV.gate, max_speed_m_s=2.0)),
            "gate.max_climb_m_s: 0.7; expected 0.86 or more",
        ),
        (
            changed("gate", max_acceleration_m_s2=0.7),
            "mission.acceleration_m_s2: 0.8; expected 0.7 or less",
        ),
        (
            replace(changed("mission", acceleration_m_s2=3.1), gate=replace(UAV.gate, max_acceleration_m_s2=9.0)),
            "mission.acceleration_m_s2: 3.1; expected 3 or less",
        ),
        (changed("gate", min_neighbour_m=1.7), "mission.arrival_range_m: 2; expected 2.05 or more"),
        (changed("gate", fence_min_m=(-50.0, -50.0, 1.45), min_height_m=0.0), "mission.takeoff_height_m: the vertical"),
        (changed("pose", min_rate_hz=50.0, stale_s=0.019), "pose.stale_s: 0.019; expected 0.02 or more"),
        (changed("aperture", max_pose_gap_s=0.04), "aperture.max_pose_gap_s: 0.04; expected 0.05 or more"),
        (changed("pose", lost_s=0.1), "pose.lost_s: 0.1; expected pose.stale_s 0.2 or more"),
        (
            replace(changed("pose", min_rate_hz=10.0), aperture=replace(UAV.aperture, max_pose_gap_s=0.1)),
            "pose.min_rate_hz: 10; expected 20 or more with autopilot.gps: false",
        ),
        (
            replace(
                changed("aperture", min_packets=300),
                csi=replace(UAV.csi, interface="mon0"), ping=replace(UAV.ping, enabled=True, rate_hz=60.0),
            ),
            "aperture.min_packets: 300; expected 180 or less",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_error_with_its_key(config: Config, error: str) -> None:
    (told,) = config_errors(config)
    assert told.startswith(error), told


@pytest.mark.parametrize(
    "config",
    [
        changed("gate", max_climb_m_s=0.48),
        changed("gate", max_acceleration_m_s2=0.8),
        changed("gate", min_neighbour_m=1.65),
        changed("pose", min_rate_hz=50.0, stale_s=0.02),
        changed("pose", lost_s=0.2),
        replace(
            changed("pose", min_rate_hz=10.0), autopilot=replace(AUTOPILOT, gps=True),
            aperture=replace(UAV.aperture, max_pose_gap_s=0.1),
        ),
        replace(changed("aperture", min_packets=180), csi=replace(UAV.csi, interface="mon0"),
                ping=replace(UAV.ping, enabled=True, rate_hz=60.0)),
    ],
)  # fmt: skip
def test_what_just_fits_is_right(config: Config) -> None:
    assert config_errors(config) == []


def test_the_figures_are_those_of_the_guidance() -> None:
    assert motions.WEAVE_GAIN == approach._WEAVE_GAIN and motions.CIRCLE_M == approach._CIRCLE_M
    assert motion._MAX_JERK_M_S3 == 8.0, "the greatest acceleration was measured with it"


@pytest.mark.parametrize("seed", range(40))
def test_the_path_is_never_faster_than_its_configuration_says(seed: int) -> None:
    """Through changes of the aim, stops, and a start far from the wanted height."""
    draw = random.Random(seed)
    mission = replace(
        UAV.mission,
        speed_m_s=draw.uniform(0.1, 2.0),
        acceleration_m_s2=draw.uniform(0.2, 3.0),
        lateral_weave_m=draw.uniform(0.0, 0.2),
        vertical_weave_m=draw.uniform(0.0, 0.2),
        takeoff_height_m=draw.uniform(1.0, 8.0),
    )
    room = replace(UAV.gate, fence_min_m=(-50.0, -50.0, -1.0), fence_max_m=(50.0, 50.0, 12.0), fence_radius_m=60.0)
    gate = replace(room, max_speed_m_s=9.0, max_climb_m_s=9.0, max_acceleration_m_s2=9.0)
    config = replace(UAV, mission=mission, gate=gate)
    assert config_errors(config) == []
    path = Approach(mission, GateLimits(**asdict(gate)), UAV.aperture.length_m)
    path.start((0.0, 0.0, draw.uniform(1.0, 8.0)), 0.0)
    level_m_s, climb_m_s = fastest(config)
    aim = None
    for tick in range(600):
        if tick % 100 == 0:
            aim = Aim(
                azimuth_rad=draw.uniform(-math.pi, math.pi),
                distance_m=draw.uniform(0.5, 20),
                distance_std_m=draw.uniform(0.1, 5),
                sureness=draw.random(),
            )
            aim = None if draw.random() < 0.3 else aim
        vx, vy, vz = path.setpoint(tick * NS_PER_S // 20, aim, tick // 60 % 7 != 0).v_local_enu_m_s
        assert math.hypot(vx, vy) <= level_m_s + 0.01 and abs(vz) <= climb_m_s + 0.01
