"""What the mock's estimator believes: GPS or vision, with PX4 1.16.1's flags, resets, time-outs and frames.

The airframe flies by the estimate, so vision that is wrong moves the vehicle. No I/O; time is a number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from companion.core.clock import NS_PER_S, age_s
from companion.core.messages import Vector3
from companion.sim.px4.airframe import Airframe
from companion.sim.px4.parameters import Parameters
from companion.sim.px4.wander import Wander

_VISION_LATE_S: Final = 0.3
"""EKF2_DELAY_MAX and the 0.1 s by which a sample may miss its time; older ones are past fusing."""
_VISION_EARLY_S: Final = 0.1
"""A sample from further in the future is never reached before newer ones replace it."""
_AIDED_S: Final = 0.6
_VALID_S: Final = 4.6
_GATE_M: Final = 0.5
"""Five deviations of EKF2_EVP_NOISE: what is further from the estimate is rejected, and after a while believed."""
_REJECTED_S: Final = 1.2
_FOLLOW_S: Final = 0.3
_DRIFT_M_S2: Final = 0.16
"""Without anything to hold on to: 2 m in 5 s."""
_SETTLE_S: Final = 20.0
_LONGEST_STEP_S: Final = 0.5
"""Of what wanders: a process that stood still does not catch up."""
_ZERO: Final[Vector3] = (0.0, 0.0, 0.0)

ATTITUDE, VELOCITY_HORIZ, VELOCITY_VERT, POS_HORIZ_REL, POS_HORIZ_ABS, POS_VERT_ABS, POS_VERT_AGL = (
    1 << bit for bit in range(7)
)
CONST_POS_MODE, PRED_POS_HORIZ_REL, PRED_POS_HORIZ_ABS = 128, 256, 512


@dataclass(frozen=True, slots=True)
class Vision:
    """One ODOMETRY in a frame that PX4 takes, in ENU; `t_ns` is when PX4 takes it to be of."""

    t_ns: int
    p_enu_m: Vector3
    reset_counter: int
    is_north_aligned: bool
    """LOCAL_NED. LOCAL_FRD may point anywhere, and takes the estimate's yaw alignment away."""


class PositionEstimator:
    """The estimate minus the truth goes into `airframe.estimate_offset_enu_m`.

    `drift_m` is how far Up wanders while the vehicle stands, in the first minute; all of it goes on with `wander` in
    flight, where GPS is what places it. `broken` is a fault to inject.
    """

    def __init__(
        self,
        airframe: Airframe,
        parameters: Parameters,
        now_ns: int,
        drift_m: float = 0.0,
        wander: Wander | None = None,
    ) -> None:
        self._airframe = airframe
        self._parameters = parameters
        self._drift_m = drift_m
        self._wander = wander
        self._wandered_m: Vector3 | None = None
        self._now_ns = self._boot_ns = now_ns
        self._drifted_m = 0.0
        self.broken = False
        self.resets = 0
        """PX4's reset_counter: rises whenever the estimate is set instead of led."""
        self.origin_altitude_m: float | None = 488.0 if self.uses_gps else None
        self.is_yaw_aligned = True
        self._fused_ns: int | None = now_ns if self.uses_gps else None
        self._rejected_since_ns: int | None = None
        self._vision_reset_counter: int | None = None
        self.fused = 0
        """Vision samples that were not dropped for their time or the parameters."""
        self.dropped = 0
        self._drift_v_m_s: Vector3 = _ZERO

    @property
    def uses_gps(self) -> bool:
        return bool(self._parameters["SYS_HAS_GPS"]) and bool(self._parameters["EKF2_GPS_CTRL"])

    @property
    def is_aided(self) -> bool:
        """Something measures the horizontal position now."""
        return not self.broken and (self.uses_gps or self._fused_s() < _AIDED_S)

    @property
    def has_local_position(self) -> bool:
        return not self.broken and (self.uses_gps or self._fused_s() < _VALID_S)

    @property
    def has_global_position(self) -> bool:
        return self.has_local_position and self.origin_altitude_m is not None and self.is_yaw_aligned

    def flags(self, at_rest: bool) -> int:
        """ESTIMATOR_STATUS.flags; CONST_POS_MODE while disarmed at rest, whatever else is so."""
        flags = ATTITUDE | VELOCITY_VERT | POS_VERT_ABS | POS_VERT_AGL
        flags |= VELOCITY_HORIZ | POS_HORIZ_REL if self.has_local_position else 0
        flags |= POS_HORIZ_ABS if self.has_global_position else 0
        flags |= CONST_POS_MODE if at_rest else 0
        flags |= PRED_POS_HORIZ_REL if self.is_aided else 0
        return flags | (PRED_POS_HORIZ_ABS if self.uses_gps and not self.broken else 0)

    def set_origin(self, altitude_m: float) -> None:
        """SET_GPS_GLOBAL_ORIGIN: taken where GPS gives none."""
        if not self.uses_gps:
            self.origin_altitude_m = altitude_m
            self.resets += 1

    def reset_by(self, delta_enu_m: Vector3) -> None:
        """The estimate is set anew, this far from where it was, and says so by its counter."""
        self._shift(delta_enu_m)
        self.resets += 1

    def vision(self, vision: Vision) -> None:
        """A sample arrived: fused, rejected for a while, or dropped without a word."""
        old_s = (self._now_ns - vision.t_ns) / NS_PER_S
        if not int(self._parameters["EKF2_EV_CTRL"]) & 1 or not -_VISION_EARLY_S <= old_s <= _VISION_LATE_S:
            self.dropped += 1
            return
        self.fused += 1
        if not vision.is_north_aligned:
            self.is_yaw_aligned = False
        elif int(self._parameters["EKF2_EV_CTRL"]) & 8:
            self.is_yaw_aligned = True
        if not self.uses_gps:
            self._follow(vision)

    def step(self, now_ns: int, stands: bool) -> None:
        """Time goes on to `now_ns`; `stands` while the vehicle is disarmed on the ground."""
        dt_s, self._now_ns = (now_ns - self._now_ns) / NS_PER_S, now_ns
        if stands:
            self._drift_at_rest()
        elif self._wander is not None and self.uses_gps and dt_s > 0.0:
            off_m, before_m = self._wander.step(min(dt_s, _LONGEST_STEP_S)), self._wandered_m
            self._wandered_m = off_m
            if before_m is not None:  # where it began is where the frame is
                self._shift((off_m[0] - before_m[0], off_m[1] - before_m[1], off_m[2] - before_m[2]))
        if self.is_aided or self._fused_ns is None:
            self._drift_v_m_s = _ZERO
        elif not stands:
            vx, vy, vz = self._drift_v_m_s
            self._drift_v_m_s = (vx + _DRIFT_M_S2 * dt_s, vy, vz)
            self._shift((vx * dt_s, 0.0, 0.0))

    def _follow(self, vision: Vision) -> None:
        error = tuple(v - p for v, p in zip(vision.p_enu_m, self._airframe.estimated_p_enu_m, strict=True))
        first = self._fused_ns is None or self._fused_s() >= _VALID_S
        told = self._vision_reset_counter is not None and vision.reset_counter != self._vision_reset_counter
        self._vision_reset_counter = vision.reset_counter
        if first or told:
            # Height is set in the origin's terms then: a high origin throws the estimate down by its altitude.
            down_m = self.origin_altitude_m or 0.0 if told else 0.0
            self.reset_by((error[0], error[1], error[2] - down_m))
        elif math.hypot(*error) > _GATE_M:
            self._rejected_since_ns = self._rejected_since_ns or self._now_ns
            if self._now_ns - self._rejected_since_ns < _REJECTED_S * NS_PER_S:
                return
            self.reset_by((error[0], error[1], error[2]))
        else:
            share = min(1.0, self._fused_s() / _FOLLOW_S)
            self._shift((share * error[0], share * error[1], share * error[2]))
        self._fused_ns, self._rejected_since_ns = self._now_ns, None

    def _drift_at_rest(self) -> None:
        up_m = self._drift_m * (1 - math.exp(-(self._now_ns - self._boot_ns) / NS_PER_S / _SETTLE_S))
        if self.uses_gps:
            self._shift((0.0, 0.0, up_m - self._drifted_m))
        self._drifted_m = up_m

    def _shift(self, delta_enu_m: Vector3) -> None:
        x, y, z = (o + d for o, d in zip(self._airframe.estimate_offset_enu_m, delta_enu_m, strict=True))
        self._airframe.estimate_offset_enu_m = (x, y, z)

    def _fused_s(self) -> float:
        return age_s(self._fused_ns, self._now_ns)
