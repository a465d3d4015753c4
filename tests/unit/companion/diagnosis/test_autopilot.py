"""What `companion doctor autopilot` says of the vehicle it finds."""

from __future__ import annotations

import pytest

from companion.core.messages import VehicleState
from companion.diagnosis.autopilot import _vehicle


def test_our_vehicle_is_named() -> None:
    check = _vehicle(VehicleState(t_mono_ns=0, system_id=1, autopilot="px4", firmware="1.16.1"), "copter")
    assert check.ok and check.found == "system 1, px4 1.16.1"


@pytest.mark.parametrize(
    ("autopilot", "said"),
    [
        ("px4 on a fixed wing", "the vehicle is no multicopter but a fixed wing"),
        ("ardupilot", "the vehicle is no PX4 but ardupilot"),
    ],
)
def test_what_engage_would_refuse_fails(autopilot: str, said: str) -> None:
    check = _vehicle(VehicleState(t_mono_ns=0, system_id=1, autopilot=autopilot), "copter")
    assert not check.ok and check.found == said
