"""The limits of the mission's conditions, as a configuration gives them."""

from __future__ import annotations

from companion.config.schema import Config
from companion.core.messages import FlightMode
from companion.mission.conditions import ConditionLimits

_LEAVE_MODES = {"hold": FlightMode.HOLD, "land": FlightMode.LAND, "return": FlightMode.RETURN}


def condition_limits(config: Config) -> ConditionLimits:
    """For `companion.mission.conditions.conditions`."""
    return ConditionLimits(
        pose_stale_s=config.pose.stale_s,
        pose_lost_s=config.pose_lost_s,
        silent_s=config.aperture.silent_s,
        blind_legs=config.aperture.blind_legs,
        min_battery=config.mission.min_battery,
        approach_s=config.mission.limit_s,
        hold_s=config.mission.hold_limit_s,
        leave_modes=frozenset({_LEAVE_MODES[config.mission.leave]}),
    )
