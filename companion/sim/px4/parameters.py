"""The mock's parameters: PX4 1.16's names, types and defaults, and its way of carrying them over MAVLink."""

from __future__ import annotations

import struct
from typing import Final

from pymavlink.dialects.v20 import development as mavlink

Parameters = dict[str, int | float]

DEFAULTS: Final[Parameters] = {
    "COM_DISARM_LAND": 2.0,
    "COM_DISARM_PRFLT": 10.0,
    "COM_OBL_RC_ACT": 0,
    "COM_OF_LOSS_T": 1.0,
    "COM_RC_OVERRIDE": 1,
    "COM_TAKEOFF_ACT": 0,
    "EKF2_EVA_NOISE": 0.1,
    "EKF2_EVP_NOISE": 0.1,
    "EKF2_EVV_NOISE": 0.1,
    "EKF2_EV_CTRL": 0,
    "EKF2_EV_DELAY": 0.0,
    "EKF2_EV_NOISE_MD": 0,
    "EKF2_GPS_CTRL": 7,
    "EKF2_HGT_REF": 1,
    "GF_ACTION": 2,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "MIS_TAKEOFF_ALT": 2.5,
    "MPC_LAND_SPEED": 0.7,
    "MPC_TKO_SPEED": 1.5,
    "NAV_ACC_RAD": 2.0,
    "NAV_MC_ALT_RAD": 0.8,
    "NAV_RCL_ACT": 2,
    "RTL_CONE_ANG": 45,
    "RTL_DESCEND_ALT": 10.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 30.0,
    "SYS_HAS_GPS": 1,
}
"""Of a multicopter, where its start script sets values of its own; an int is an INT32 parameter."""


def field_and_kind(value: int | float) -> tuple[float, int]:
    """PARAM_VALUE's value and type: the bytes of an INT32 stand where the float would be."""
    if isinstance(value, int):
        return struct.unpack("<f", struct.pack("<i", value))[0], int(mavlink.MAV_PARAM_TYPE_INT32)
    return value, int(mavlink.MAV_PARAM_TYPE_REAL32)


def written(before: int | float, field: float, kind: int) -> int | float | None:
    """The value after a PARAM_SET; None where the type is not the parameter's, which PX4 ignores without an answer."""
    if kind != field_and_kind(before)[1]:
        return None
    return int(struct.unpack("<i", struct.pack("<f", field))[0]) if isinstance(before, int) else field


def parsed(name: str, text: str) -> int | float:
    """A parameter in the type PX4 has it in. Raises KeyError for a name the mock does not have, ValueError."""
    return int(text) if isinstance(DEFAULTS[name], int) else float(text)
