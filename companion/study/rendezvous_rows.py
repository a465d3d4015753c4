"""What a simulated mission leaves behind."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from companion.study.belief import BeliefCheck
from companion.study.virtual_mission import RENDEZVOUS_M

FALSE_M = 3.0
"""Who calls itself arrived farther away than this is at another place."""


class FlownIteration(NamedTuple):
    """One SAR iteration; None where it gave no estimate, or the number is infinite. Errors are in degrees, `paper_deg`
    by the paper's measure. `crb_deg` is the great-circle bound of the estimate at its own noise, `informativeness_deg`
    the same of the aperture as the service logs it."""

    number: int
    time_s: float
    """Of the reference point, from engaging."""
    distance_m: float
    beacon_moving: bool
    azimuth_deg: float | None
    paper_deg: float | None
    great_circle_deg: float | None
    crb_deg: float | None
    informativeness_deg: float | None
    reliability: float | None
    refusal: str
    belief: BeliefCheck | None
    """What the tracker then made of the target; None where the iteration steered nothing or no place was known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionRow:
    """Times are from engaging."""

    scene: str
    number: int
    """Within the scene."""
    time_s: float
    """To the end."""
    straight_s: float
    """What straight flight takes to within 2 m that knows where the robot is, at the same speed and acceleration; from
    engaging too, so with the second of set points before OFFBOARD."""
    end: str
    """State in which the mission ended, or was in when its time was over."""
    closest_m: float
    reached_s: float | None
    """When the antennas were first within 2 m."""
    arrived_m: float | None
    """Their distance when the vehicle called itself arrived; None if it never did."""
    left_room: bool
    """The vehicle flew through a wall, floor or ceiling."""
    draws_truths: bool
    """Distance and North were drawn, in place of the scene's."""
    steps: list[FlownIteration]

    @property
    def succeeded(self) -> bool:
        return self.arrived_m is not None and self.arrived_m <= RENDEZVOUS_M

    @property
    def arrived_falsely(self) -> bool:
        return self.arrived_m is not None and self.arrived_m > FALSE_M

    @property
    def kept_silent(self) -> bool:
        """It came within 2 m and never said so, or did elsewhere."""
        return self.reached_s is not None and (self.arrived_m is None or self.arrived_m > FALSE_M)

    @property
    def approach(self) -> list[FlownIteration]:
        """The iterations until the antennas were first within 2 m, which the paper's mission ended at."""
        until_s = math.inf if self.reached_s is None else self.reached_s
        return [step for step in self.steps if step.time_s <= until_s]
