"""What a mock autopilot would tell the world of its vehicle."""

from __future__ import annotations

from companion.core.messages import Vector3
from companion.sim.truth import VehicleTruth


def vehicle_truth(
    t_mono_ns: int, p_enu_m: Vector3, v_enu_m_s: Vector3 = (0.0, 0.0, 0.0), mode: str = "OFFBOARD"
) -> VehicleTruth:
    """Of one that faces East and has had no set points yet; armed but in HOLD."""
    return VehicleTruth(
        t_mono_ns=t_mono_ns,
        p_enu_m=p_enu_m,
        v_enu_m_s=v_enu_m_s,
        yaw_enu_rad=0.0,
        mode=mode,
        armed=mode != "HOLD",
        setpoints=0,
        setpoints_in_offboard=0,
        offboard_s=0.0,
    )
