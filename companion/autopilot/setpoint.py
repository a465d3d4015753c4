"""Set points as MAVLink message 84: a velocity, and a place and a heading where they are wanted."""

from __future__ import annotations

from typing import Any, Final

from companion.core.messages import Setpoint
from wsr.frames import ned_of_enu, yaw_ned_from_enu

_FRAME_LOCAL_NED: Final = 1
_IGNORE_ACCELERATION_AND_YAW_RATE: Final = 64 | 128 | 256 | 2048
_IGNORE_POSITION: Final = 1 | 2 | 4
_IGNORE_YAW: Final = 1024


def setpoint_fields(setpoint: Setpoint) -> dict[str, Any]:
    """All but the address. What is not wanted is 0 and masked."""
    ignored = _IGNORE_ACCELERATION_AND_YAW_RATE
    ignored |= _IGNORE_POSITION if setpoint.p_local_enu_m is None else 0
    ignored |= _IGNORE_YAW if setpoint.yaw_enu_rad is None else 0
    x, y, z = ned_of_enu(*(setpoint.p_local_enu_m or (0.0, 0.0, 0.0)))
    vx, vy, vz = ned_of_enu(*setpoint.v_local_enu_m_s)
    return {
        "time_boot_ms": setpoint.t_mono_ns // 1_000_000 & 0xFFFFFFFF,
        "coordinate_frame": _FRAME_LOCAL_NED,
        "type_mask": ignored,
        "x": x,
        "y": y,
        "z": z,
        "vx": vx,
        "vy": vy,
        "vz": vz,
        "afx": 0.0,
        "afy": 0.0,
        "afz": 0.0,
        "yaw": 0.0 if setpoint.yaw_enu_rad is None else yaw_ned_from_enu(setpoint.yaw_enu_rad),
        "yaw_rate": 0.0,
    }
