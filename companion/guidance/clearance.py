"""Around other robots than the target: the gate refuses set points too near to them, so none is wished for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from companion.core.messages import Vector3

_MARGIN_M: Final = 0.35
"""Beyond the gate's least distance."""
_NEARING_PER_S: Final = 0.9
"""Metres left to it to m/s towards it."""


def clear_of(v_m_s: Vector3, p_m: Vector3, others_m: Sequence[Vector3], least_m: float) -> Vector3:
    """The velocity, turned aside where it would lead nearer than `least_m` to one of `others_m`: it slides around each
    on the side on which it would have passed, at its own speed. Heights count: from far enough above, nothing is in the
    way."""
    vx, vy, vz = v_m_s
    for other_m in others_m:
        east, north, up = (o - p for o, p in zip(other_m, p_m, strict=True))
        away_m = math.hypot(east, north)
        keep_m = math.sqrt(max(0.0, (least_m + _MARGIN_M) ** 2 - up**2))
        if away_m < 1e-6 or keep_m == 0.0:
            continue
        ux, uy = east / away_m, north / away_m
        nearing, across = vx * ux + vy * uy, vy * ux - vx * uy
        most = _NEARING_PER_S * (away_m - keep_m)
        if nearing <= most:
            continue
        speed = math.hypot(vx, vy)
        nearing = max(-speed, most)
        across = math.copysign(math.sqrt(max(0.0, speed**2 - nearing**2)), across)
        vx, vy = nearing * ux - across * uy, nearing * uy + across * ux
    return vx, vy, vz
