"""Which way to fly: a velocity for where the vehicle is and for what is known of the target. Pure, without memory."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from companion.core.messages import Vector3
from companion.guidance.target import Scatter
from companion.safety.gate import GateLimits

_RADIAL_PER_S: Final = 0.9
"""Metres too far from the circle around the target to m/s."""
_HEIGHT_PER_S: Final = 0.5
_FENCE_MARGIN_M: Final = 0.6
_FENCE_PER_S: Final = 0.5
_LEAD_RAD: Final = (math.radians(10.0), math.radians(28.0))
"""So far beside the target the vehicle flies at least while its range is not known at all, from afar and from near:
bearings from one line of flight do not cross. From near the way round costs little and turns the bearing fast."""
_LEAD_M: Final = (7.0, 3.5)
"""What is afar and near here."""
_VAGUE: Final = 0.5
"""A range of this relative deviation, or more, is not known at all."""
_SEARCH_RADIUS_M: Final = 0.6
_SEARCH_GROWTH_M: Final = 0.35
"""By which the circle of a search is wider after each turn."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Aim:
    """What is known of the target from where the vehicle is: azimuth, distance on the level, the deviation of that,
    how sure the direction is, 0..1, how far above the vehicle it is, and, where motion is chosen, a few places where it
    may be: the same object until a bearing changes them."""

    azimuth_rad: float
    distance_m: float
    distance_std_m: float
    sureness: float
    above_m: float = 0.0
    scatter: Scatter | None = None


def towards(aim: Aim, speed_m_s: float, circle_m: float, side: int, *, lead_rad: float = 0.0) -> tuple[float, float]:
    """East and North [m/s] towards the target, `lead_rad` beside it, or more while its range is vague, and around it on
    a circle of `circle_m` from near. `side` is +1 for a target kept to the right, -1 to the left."""
    inwards = max(-speed_m_s, min(speed_m_s, _RADIAL_PER_S * (aim.distance_m - circle_m)))
    known = math.isfinite(aim.distance_m)
    vague = min(1.0, aim.distance_std_m / max(aim.distance_m, 0.1) / _VAGUE) if known else 1.0
    nearness = (_LEAD_M[0] - aim.distance_m) / (_LEAD_M[0] - _LEAD_M[1]) if known else 0.0
    least_rad = vague * (_LEAD_RAD[0] + (_LEAD_RAD[1] - _LEAD_RAD[0]) * max(0.0, min(1.0, nearness)))
    inwards = min(inwards, speed_m_s * math.cos(max(lead_rad, least_rad)))
    around = side * math.sqrt(max(0.0, speed_m_s**2 - inwards**2))
    c, s = math.cos(aim.azimuth_rad), math.sin(aim.azimuth_rad)
    return inwards * c - around * s, inwards * s + around * c


def search(flown_m: float, heading_rad: float, speed_m_s: float) -> tuple[float, float]:
    """East and North [m/s] of a widening spiral, `flown_m` after its beginning along `heading_rad`: a path that tells
    all directions apart."""
    # Of a spiral whose radius grows by g in each turn: flown = 2 pi n (r0 + g n / 2) after n turns.
    g, r0 = _SEARCH_GROWTH_M, _SEARCH_RADIUS_M
    turns = (math.sqrt(r0**2 + g * flown_m / math.pi) - r0) / g
    angle = heading_rad + math.tau * turns
    return speed_m_s * math.cos(angle), speed_m_s * math.sin(angle)


def climb(p_up_m: float, wanted_up_m: float, most_m_s: float) -> float:
    """Up [m/s] to the wanted height."""
    return max(-most_m_s, min(most_m_s, _HEIGHT_PER_S * (wanted_up_m - p_up_m)))


def kept_inside(v_m_s: Vector3, p_m: Vector3, limits: GateLimits, ground_m: float) -> Vector3:
    """The velocity without what would take it too near to the fence, box and cylinder, or to the least height above the
    ground (Up)."""
    if limits.on_ground:
        v_m_s, p_m = (v_m_s[0], v_m_s[1], 0.0), (p_m[0], p_m[1], 0.0)
    (low_x, low_y, low_z), (high_x, high_y, high_z) = limits.fence_min_m, limits.fence_max_m
    (vx, vy, vz), (px, py, pz) = limits.in_box_axes(v_m_s), limits.in_box_axes(p_m)
    kept = (
        _kept_between(low_x, high_x, px, vx),
        _kept_between(low_y, high_y, py, vy),
        _kept_between(max(low_z, ground_m + limits.min_height_m), high_z, pz, vz),
    )
    x, y, z = limits.in_enu_axes(kept)
    out_m = math.hypot(p_m[0], p_m[1])
    if out_m > 1e-6:
        ux, uy = p_m[0] / out_m, p_m[1] / out_m
        too_fast = x * ux + y * uy - _FENCE_PER_S * (limits.fence_radius_m - _FENCE_MARGIN_M - out_m)
        if too_fast > 0:
            x, y = x - too_fast * ux, y - too_fast * uy
    return x, y, 0.0 if limits.on_ground else z


def _kept_between(low: float, high: float, p: float, v: float) -> float:
    """The velocity along one axis of the box."""
    margin = min(_FENCE_MARGIN_M, (high - low) / 2)
    return max(_FENCE_PER_S * (low + margin - p), min(_FENCE_PER_S * (high - margin - p), v))
