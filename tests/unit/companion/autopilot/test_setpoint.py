"""The fields of SET_POSITION_TARGET_LOCAL_NED against MAVLink's own names of its bits."""

from __future__ import annotations

import math

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.autopilot.setpoint import setpoint_fields
from companion.core.messages import Setpoint

_BASE = (
    mavlink.POSITION_TARGET_TYPEMASK_AX_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AY_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_AZ_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
)
_NO_PLACE = (
    mavlink.POSITION_TARGET_TYPEMASK_X_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Y_IGNORE
    | mavlink.POSITION_TARGET_TYPEMASK_Z_IGNORE
)


@pytest.mark.parametrize("place", [None, (1.0, 2.0, 3.0)])
@pytest.mark.parametrize("yaw_rad", [None, math.pi / 6])
def test_what_is_not_wanted_is_masked(place: tuple[float, float, float] | None, yaw_rad: float | None) -> None:
    fields = setpoint_fields(
        Setpoint(t_mono_ns=5_000_000_000, v_local_enu_m_s=(0.1, 0.2, 0.3), p_local_enu_m=place, yaw_enu_rad=yaw_rad)
    )
    unwanted = (_NO_PLACE if place is None else 0) | (
        mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE if yaw_rad is None else 0
    )
    assert fields["type_mask"] == _BASE | unwanted
    assert fields["coordinate_frame"] == mavlink.MAV_FRAME_LOCAL_NED and fields["time_boot_ms"] == 5000
    assert (fields["vx"], fields["vy"], fields["vz"]) == (0.2, 0.1, -0.3), "East, North, Up as North, East, Down"
    assert (fields["x"], fields["y"], fields["z"]) == ((0.0, 0.0, 0.0) if place is None else (2.0, 1.0, -3.0))
    assert fields["yaw"] == pytest.approx(0.0 if yaw_rad is None else math.pi / 3), "clockwise from North"
    assert {fields[name] for name in ("afx", "afy", "afz", "yaw_rate")} == {0.0}, "beside being masked"
    message = mavlink.MAVLink_set_position_target_local_ned_message(target_system=1, target_component=1, **fields)
    assert message.type_mask == fields["type_mask"]


def test_milliseconds_that_no_longer_fit_begin_anew() -> None:
    assert setpoint_fields(Setpoint(2**32 * 1_000_000 + 7_000_000, None, (0.0, 0.0, 0.0), None))["time_boot_ms"] == 7
