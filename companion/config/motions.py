"""Speeds, rates and ranges of a configuration that must fit each other: what one key asks for, another must let be.

How the vehicle is led is `companion.guidance`'s; its figures stand here again, since a configuration knows of no path.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from companion.config.schema import Config

WEAVE_GAIN: Final = 1.3
WEAVE_SHARE: Final = 0.8
"""Of the acceleration, which the weave may take."""
AWAY_M_S: Final = 0.3
"""From a fence that it touches the vehicle is led away so fast."""
CIRCLE_M: Final = 0.35
"""The vehicle circles a target by so much farther out than `gate.min_neighbour_m`."""
MOST_ACCELERATION_M_S2: Final = 3.0
"""The path's jerk is bounded: of a greater acceleration its velocity would overshoot what is asked for."""
MIN_VIO_HZ: Final = 20.0


def fastest(config: Config) -> tuple[float, float]:
    """The most that is ever asked for along the path, level and up or down [m/s]: the way on and the weave's turns."""
    mission = config.mission
    rate = math.tau / config.aperture.length_m * mission.speed_m_s
    most_m = WEAVE_SHARE * mission.acceleration_m_s2 / rate**2
    across, up = (
        WEAVE_GAIN * rate * min(wide_m, most_m) for wide_m in (mission.lateral_weave_m, mission.vertical_weave_m)
    )
    level = max(mission.speed_m_s, math.hypot(0.5 * mission.speed_m_s, across), AWAY_M_S)
    return level, max(mission.speed_m_s / 2 + up, AWAY_M_S)


def speed_errors(config: Config) -> Iterator[str]:
    """What the mission asks for and the gate would refuse."""
    mission, gate = config.mission, config.gate
    level_m_s, climb_m_s = fastest(config)
    if mission.speed_m_s > gate.max_speed_m_s:
        yield "mission.speed_m_s: above gate.max_speed_m_s, the gate would refuse every set point"
    elif level_m_s > gate.max_speed_m_s:
        yield (
            f"mission.lateral_weave_m: its turns take {level_m_s:.2f} m/s at mission.speed_m_s {mission.speed_m_s:g}; "
            f"expected no more than gate.max_speed_m_s {gate.max_speed_m_s:g}"
        )
    if climb_m_s > gate.max_climb_m_s:
        yield (
            f"gate.max_climb_m_s: {gate.max_climb_m_s:g}; expected {climb_m_s:.2f} or more, which heights and "
            f"mission.vertical_weave_m take at mission.speed_m_s {mission.speed_m_s:g}"
        )
    most_m_s2 = min(gate.max_acceleration_m_s2, MOST_ACCELERATION_M_S2)
    if mission.acceleration_m_s2 > most_m_s2:
        yield (
            f"mission.acceleration_m_s2: {mission.acceleration_m_s2:g}; expected {most_m_s2:g} or less, by "
            "gate.max_acceleration_m_s2 and by the jerk of the path, whose velocity would overshoot"
        )


def range_errors(config: Config) -> Iterator[str]:
    """Places that can never be reached."""
    mission, gate = config.mission, config.gate
    nearest_m = gate.min_neighbour_m + CIRCLE_M
    if mission.arrival_range_m < nearest_m:
        yield (
            f"mission.arrival_range_m: {mission.arrival_range_m:g}; expected {nearest_m:g} or more, since the vehicle "
            f"keeps {CIRCLE_M:g} m more than gate.min_neighbour_m from its target"
        )
    if mission.takeoff_height_m - mission.vertical_weave_m < gate.fence_min_m[2]:
        yield "mission.takeoff_height_m: the vertical weave would reach below gate.fence_min_m"


def rate_errors(config: Config) -> Iterator[str]:
    """Periods that are longer than what waits for them."""
    pose, aperture = config.pose, config.aperture
    period_s = 1 / pose.min_rate_hz
    for key, longest_s in (("pose.stale_s", pose.stale_s), ("aperture.max_pose_gap_s", aperture.max_pose_gap_s)):
        if longest_s < period_s - 1e-9:
            yield f"{key}: {longest_s:g}; expected {period_s:g} or more, the time between poses at pose.min_rate_hz"
    if config.pose_lost_s < pose.stale_s:
        yield f"pose.lost_s: {config.pose_lost_s:g}; expected pose.stale_s {pose.stale_s:g} or more"
    if config.flies_by_poses and pose.min_rate_hz < MIN_VIO_HZ:
        yield (
            f"pose.min_rate_hz: {pose.min_rate_hz:g}; expected {MIN_VIO_HZ:g} or more with autopilot.gps: false, or "
            "the estimator has no position"
        )
    if config.ping.enabled and config.role == "uav" and config.peers:
        answers = config.ping.rate_hz / len(config.peers) * aperture.length_m / config.mission.speed_m_s
        if answers < aperture.min_packets:
            yield (
                f"aperture.min_packets: {aperture.min_packets}; expected {math.floor(answers)} or less, as many pings "
                "as one peer gets while aperture.length_m is flown"
            )
