"""Limits are the configuration's, each under its own name."""

from __future__ import annotations

from dataclasses import fields, replace

from companion.config.file import load_config
from companion.core.messages import FlightMode
from companion.flight.limits import condition_limits, gate_limits
from tests.paths import CONFIGS

_CONFIG = load_config(CONFIGS / "uav.yaml")


def test_every_limit_of_the_gate_is_the_configurations() -> None:
    limits = gate_limits(_CONFIG)
    for field in fields(_CONFIG.gate):
        assert getattr(limits, field.name) == getattr(_CONFIG.gate, field.name)
    assert not limits.on_ground
    rover = replace(_CONFIG, mission=replace(_CONFIG.mission, vehicle="rover"))
    assert gate_limits(rover).on_ground


def test_conditions_take_what_their_names_say() -> None:
    mission = replace(_CONFIG.mission, min_battery=0.31, limit_s=321.0, hold_limit_s=12.5, leave="land")
    aperture = replace(_CONFIG.aperture, silent_s=2.25, blind_legs=4)
    limits = condition_limits(
        replace(_CONFIG, mission=mission, aperture=aperture, pose=replace(_CONFIG.pose, stale_s=0.125))
    )
    assert (limits.min_battery, limits.approach_s, limits.hold_s) == (0.31, 321.0, 12.5)
    assert (limits.silent_s, limits.blind_legs, limits.pose_stale_s) == (2.25, 4, 0.125)
    assert limits.leave_modes == {FlightMode.LAND}
