"""A tracking camera with a T265's errors: true motion in, drifting poses in its own frame and axes out. No I/O.

Each true step dp of the position is reported as

    R_z(psi) (1 + s) (dp + b |dp|) + w

with a constant scale error s, a slowly varying bias b (Ornstein-Uhlenbeck), a random walk w that goes on at rest, and
a yaw error psi that drifts slowly from what the start heading was off: the errors grow with the path as those of a
real T265 do, and a camera at rest hardly drifts.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from companion.core.messages import Quaternion, Vector3
from companion.pose.wire import PoseFrame, RawPose
from companion.sim.scenario import VioScenario

_VIO_STREAM: Final = 4
_BLOCK: Final = 256
_PER_POSE: Final = 10
_HALF: Final = math.sqrt(0.5)
_T265_FROM_ENU: Final[Quaternion] = (_HALF, -_HALF, 0.0, 0.0)
"""Turns a vector (E, N, U) into the tracker's world axes: X = E, Y = U, Z = -N."""
_FLU_FROM_CAMERA: Final[Quaternion] = (0.5, 0.5, -0.5, -0.5)
"""Forward = -Z, left = -X, up = Y of the camera."""


class Camera:
    """One drifting tracker. Its frame starts at the first pose; `frame_yaw_rad` turns that frame to East and North."""

    def __init__(self, vio: VioScenario, seed: int, robot: int, frame_yaw_rad: float) -> None:
        self._rng = np.random.default_rng([seed, _VIO_STREAM, robot])
        self._vio = vio
        self._frame_yaw_rad = frame_yaw_rad
        scale, yaw_rate, *bias, north = self._rng.standard_normal(6).tolist()
        self._scale = 1 + vio.scale_std * scale
        self._yaw_rate_rad_s = vio.yaw_rate_std_rad_s * yaw_rate
        self._bias = [vio.bias_std * value for value in bias]
        self._draws: list[list[float]] = []
        self._yaw_error_rad = vio.north_std_rad * north
        self._p_m = [0.0, 0.0, 0.0]
        self._previous: tuple[int, Vector3] | None = None

    def pose(self, t_mono_ns: int, p_enu_m: Vector3, yaw_rad: float) -> RawPose:
        """The pose reported at `t_mono_ns`; calls must come in the order of time."""
        draws = self._take()
        velocity = (0.0, 0.0, 0.0)
        if self._previous is not None:
            dt_s = (t_mono_ns - self._previous[0]) * 1e-9
            step = self._step([p - q for p, q in zip(p_enu_m, self._previous[1], strict=True)], dt_s, draws)
            self._p_m = [p + s for p, s in zip(self._p_m, step, strict=True)]
            velocity = _t265_axes([s / dt_s for s in step])
        self._previous = (t_mono_ns, p_enu_m)
        seen = [p + self._vio.jitter_m * noise for p, noise in zip(self._p_m, draws[7:], strict=True)]
        yaw = yaw_rad - self._frame_yaw_rad + self._yaw_error_rad
        return RawPose(
            t_mono_ns=t_mono_ns,
            position_m=_t265_axes(seen),
            quaternion_wxyz=_t265_attitude(yaw),
            velocity_m_s=velocity,
            confidence=3,
            frame=PoseFrame.T265,
        )

    def _step(self, true_step_m: list[float], dt_s: float, draws: list[float]) -> list[float]:
        """The reported step in the camera's frame (its axes East, North, Up)."""
        vio = self._vio
        self._yaw_error_rad += self._yaw_rate_rad_s * dt_s + vio.yaw_walk_rad_sqrt_s * math.sqrt(dt_s) * draws[0]
        keep = math.exp(-dt_s / vio.bias_correlation_s)
        stir = vio.bias_std * math.sqrt(1 - keep * keep)
        self._bias = [keep * b + stir * d for b, d in zip(self._bias, draws[1:4], strict=True)]
        length_m = math.hypot(*true_step_m)
        walk = vio.walk_m_sqrt_s * math.sqrt(dt_s)
        x, y, z = (self._scale * (p + b * length_m) for p, b in zip(true_step_m, self._bias, strict=True))
        turn = self._yaw_error_rad - self._frame_yaw_rad
        cos, sin = math.cos(turn), math.sin(turn)
        turned = (cos * x - sin * y, sin * x + cos * y, z)
        return [p + walk * d for p, d in zip(turned, draws[4:7], strict=True)]

    def _take(self) -> list[float]:
        if not self._draws:
            self._draws = self._rng.standard_normal((_BLOCK, _PER_POSE)).tolist()
        return self._draws.pop()


def _t265_axes(v: list[float]) -> Vector3:
    return (v[0], v[2], -v[1])


def _t265_attitude(yaw_rad: float) -> Quaternion:
    level = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
    return _multiply(_multiply(_T265_FROM_ENU, level), _FLU_FROM_CAMERA)


def _multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )
