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
            (px, py, pz), (qx, qy, qz), (x, y, z) = p_enu_m, self._previous[1], self._p_m
            sx, sy, sz = self._step((px - qx, py - qy, pz - qz), dt_s, draws)
            self._p_m = [x + sx, y + sy, z + sz]
            velocity = _t265_axes((sx / dt_s, sy / dt_s, sz / dt_s))
        self._previous = (t_mono_ns, p_enu_m)
        (x, y, z), jitter_m = self._p_m, self._vio.jitter_m
        seen = (x + jitter_m * draws[7], y + jitter_m * draws[8], z + jitter_m * draws[9])
        yaw = yaw_rad - self._frame_yaw_rad + self._yaw_error_rad
        return RawPose(
            t_mono_ns=t_mono_ns,
            position_m=_t265_axes(seen),
            quaternion_wxyz=_t265_attitude(yaw),
            velocity_m_s=velocity,
            confidence=3,
            frame=PoseFrame.T265,
        )

    def _step(self, true_step_m: Vector3, dt_s: float, draws: list[float]) -> Vector3:
        """The reported step in the camera's frame (its axes East, North, Up)."""
        vio, root_s = self._vio, math.sqrt(dt_s)
        self._yaw_error_rad += self._yaw_rate_rad_s * dt_s + vio.yaw_walk_rad_sqrt_s * root_s * draws[0]
        keep = math.exp(-dt_s / vio.bias_correlation_s)
        stir = vio.bias_std * math.sqrt(1 - keep * keep)
        bx, by, bz = self._bias
        bx, by, bz = keep * bx + stir * draws[1], keep * by + stir * draws[2], keep * bz + stir * draws[3]
        self._bias = [bx, by, bz]
        px, py, pz = true_step_m
        length_m = math.hypot(px, py, pz)
        walk, scale = vio.walk_m_sqrt_s * root_s, self._scale
        x, y, z = scale * (px + bx * length_m), scale * (py + by * length_m), scale * (pz + bz * length_m)
        turn = self._yaw_error_rad - self._frame_yaw_rad
        cos, sin = math.cos(turn), math.sin(turn)
        return (
            cos * x - sin * y + walk * draws[4],
            sin * x + cos * y + walk * draws[5],
            z + walk * draws[6],
        )

    def _take(self) -> list[float]:
        if not self._draws:
            self._draws = self._rng.standard_normal((_BLOCK, _PER_POSE)).tolist()
        return self._draws.pop()


def _t265_axes(v: Vector3) -> Vector3:
    return (v[0], v[2], -v[1])


def _t265_attitude(yaw_rad: float) -> Quaternion:
    # (sqrt 1/2, -sqrt 1/2, 0, 0), which turns (E, N, U) into the tracker's world axes X = E, Y = U, Z = -N, times the
    # yaw, times (1/2, 1/2, -1/2, -1/2): forward = -Z, left = -X, up = Y of the camera.
    level, turn = _HALF * math.cos(yaw_rad / 2), 0.5 * (_HALF * math.sin(yaw_rad / 2))
    return (level + turn + turn, 0.0, turn - level + turn, 0.0)
