"""How long a flight takes that knows where the robot is: the measure of what looking for it costs."""

from __future__ import annotations

import math
from typing import Final

from companion.core.messages import Vector3
from companion.sim.scenario import Scenario
from companion.sim.trajectory import BeaconDrive

_STEP_S: Final = 0.05
_LIMIT_S: Final = 600.0


def straight_flight_s(
    scenario: Scenario,
    start_m: Vector3,
    beacon_lever_m: Vector3,
    near_m: float,
    *,
    speed_m_s: float,
    acceleration_m_s2: float,
    begins_s: float = 0.0,
) -> float:
    """From rest at `start_m`, where it stays for `begins_s`, until `near_m` from the beacon's antenna, always straight
    at it, within the limits; infinite where that takes ten minutes or more."""
    drive = BeaconDrive(scenario)
    at_m, flown_s = start_m, 0.0
    while flown_s < _LIMIT_S:
        x, y, z = (p + lever for p, lever in zip(drive.place(flown_s), beacon_lever_m, strict=True))
        left_m = math.dist(at_m, (x, y, z))
        if left_m <= near_m:
            return flown_s
        drive.watch(flown_s, left_m, math.hypot(at_m[0] - start_m[0], at_m[1] - start_m[1]))
        flown_s += _STEP_S
        share = min(speed_m_s, acceleration_m_s2 * max(0.0, flown_s - begins_s)) * _STEP_S / left_m
        at_m = (at_m[0] + share * (x - at_m[0]), at_m[1] + share * (y - at_m[1]), at_m[2] + share * (z - at_m[2]))
    return math.inf
