"""The limits of the gate and of the mission's conditions, as a configuration gives them."""

from __future__ import annotations

from dataclasses import asdict

from companion.config.schema import Config
from companion.core.messages import FlightMode
from companion.mission.conditions import ConditionLimits
from companion.safety.gate import GateLimits

_LEAVE_MODES = {"hold": FlightMode.HOLD, "land": FlightMode.LAND, "return": FlightMode.RETURN}


def gate_limits(config: Config) -> GateLimits:
    """For `companion.safety.gate.Gate`, and for whoever keeps within it beforehand."""
    return GateLimits(**asdict(config.gate), on_ground=config.mission.vehicle == "rover")


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
