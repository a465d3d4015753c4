"""A phase that grows evenly with time: what a constant error of the tracked velocity does to an aperture.

Poses that err by b t turn the channel by 2 pi u . b t / lambda: within one aperture a linear phase, whatever b is. A
search over its turns a, from one end of the aperture to the other, gives the coherence back,

    F(u, r, a) = F of the bins turned by exp(j 2 pi a tau),   tau from -1/2 to 1/2.

Geometry has to tell it from a direction: on a line, or nearly one, both are the same. And it is one more parameter, so
it is believed only where it explains at least half of the power that does not add up without it; a second path or a
random walk, whose phase is no line, leaves more than that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from wsr.focus import Bounds, Focus, refine
from wsr.geometry import direction, perpendicular
from wsr.subapertures import SubApertures, score_together
from wsr.uncertainty import is_determined, phase_slopes

# Trackers that err by more than this share of the path have failed.
_MAX_BIAS = 0.1
_TURN_STEP = 0.5
# Around the best directions without it, so far and so closely: a bias of 10 % moves them by 6 degrees.
_REACH_RAD, _STEP_RAD = math.radians(12.0), math.radians(2.0)
_ROUNDS, _STEPS_A_ROUND = 3, 4
_EXPLAINED = 0.5
# What it may cost of the bound of the direction before geometry is said not to tell the two apart.
_MAX_LOSS = 10.0

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Drift:
    """The focus with the linear phase taken out, its turns over the aperture, and tau (B,) of the bins."""

    focus: Focus
    turns: float
    tau: Array
    parts: SubApertures


def find_drift(
    parts: SubApertures,
    t_s: Array,
    focus: Focus,
    starts: list[tuple[float, float]],
    *,
    ranges_m: tuple[float | None, ...],
    beam_rad: float,
    bounds: Bounds,
) -> Drift | None:
    """The linear phase over the bins' times t (B,), if there is one to believe; searched around each of the `starts`
    (azimuth, polar angle). None where geometry cannot tell, or where it explains too little."""
    whole = parts.whole()
    tau = (t_s - t_s.mean()) / max(float(np.ptp(t_s)), 1e-9)
    x_m = whole.x.T.astype(np.float64) * whole.wavelength_m
    if focus.coherence >= 1.0 or not is_told_apart(x_m, tau, whole.wavelength_m, focus, level=bounds.planar):
        return None
    path_turns = float(np.linalg.norm(np.diff(x_m, axis=0), axis=1).sum()) / whole.wavelength_m
    most = max(_TURN_STEP, _MAX_BIAS * path_turns)
    around = np.concatenate([_cap(azimuth, polar) for azimuth, polar in starts])
    best = (-1.0, 0.0, around[0], ranges_m[0])
    steps = [float(turns) for turns in np.arange(-most, most + _TURN_STEP / 2, _TURN_STEP)]
    for turns, scores in zip(
        steps, score_together(_turned_all(whole, tau, steps), around, ranges_m, None), strict=True
    ):
        coherence = scores.coherence[0]
        n, r = np.unravel_index(int(np.argmax(coherence)), coherence.shape)
        if coherence[n, r] > best[0]:
            best = (float(coherence[n, r]), turns, around[n], ranges_m[r])
    found = _refined(whole, tau, best[1], best[2], range_m=best[3], beam_rad=beam_rad, bounds=bounds)
    if 1.0 - found.focus.coherence > _EXPLAINED * (1.0 - focus.coherence):
        return None
    return found


def is_told_apart(x_m: Array, tau: Array, wavelength_m: float, focus: Focus, *, level: bool = False) -> bool:
    """Whether bins x (B, 3) tell a linear phase over tau (B,) from a direction; `level`: from an azimuth."""
    slopes = phase_slopes(x_m - x_m.mean(axis=0), wavelength_m, focus.azimuth_rad, focus.polar_rad, range_m=None)
    rows = (slopes - slopes.mean(axis=0))[:, : 1 if level else 2]
    ramp = tau - tau.mean()
    lost = ramp @ rows
    told = rows.T @ rows
    left = told - np.outer(lost, lost) / max(float(ramp @ ramp), 1e-300)
    scale = np.sqrt(np.diag(told))
    if not (scale > 0.0).all() or not (is_determined(told, scale) and is_determined(left, scale)):
        return False
    # In the direction across which it costs most: neither angle need show it where both are hardly known.
    return float(np.max(np.linalg.eigvals(np.linalg.solve(left, told)).real)) <= _MAX_LOSS**2


def turned(parts: SubApertures, tau: Array, turns: float) -> SubApertures:
    """The same bins with the phase of so many turns put on them."""
    rotated = (parts.h[0] + 1j * parts.h[1]) * np.exp(2j * math.pi * turns * tau).astype(np.complex64)
    return replace(parts, h=np.ascontiguousarray(np.stack([rotated.real, rotated.imag]), np.float32))


def _turned_all(parts: SubApertures, tau: Array, steps: list[float]) -> list[SubApertures]:
    """The same condensed, for each of many turns: one skeleton serves all."""
    h = (parts.h[0] + 1j * parts.h[1]).T
    waves = np.exp(2j * math.pi * tau[:, None] * np.array(steps))
    return parts.with_channels((waves[:, :, None] * h[:, None, :]).reshape(len(tau), -1))


def _cap(azimuth: float, polar: float) -> Array:
    """Directions (N, 3) within _REACH_RAD."""
    u = direction(azimuth, polar)
    east, north = perpendicular(u)
    steps = np.arange(-_REACH_RAD, _REACH_RAD + 1e-9, _STEP_RAD)
    a, b = (axis.ravel()[:, None] for axis in np.meshgrid(steps, steps))
    around = u + np.tan(a) * east + np.tan(b) * north
    return np.asarray(around / np.linalg.norm(around, axis=1, keepdims=True))


def _refined(
    parts: SubApertures, tau: Array, turns: float, u: Array, *, range_m: float | None, beam_rad: float, bounds: Bounds
) -> Drift:
    """Direction and range by `refine`, turns by parabolas, in turn."""
    azimuth, polar = math.atan2(u[1], u[0]), math.acos(min(max(float(u[2]), -1.0), 1.0))
    focus = Focus(azimuth, polar, range_m, 0.0)
    width, step_rad = 0.25, _STEP_RAD
    climb = partial(refine, beam_rad=beam_rad, bounds=bounds, delay_ns=None, coherent_above=2.0, steps=_STEPS_A_ROUND)
    for _ in range(_ROUNDS):
        start = (focus.azimuth_rad, focus.polar_rad, focus.range_m)
        here, *beside = _turned_all(parts, tau, [turns, turns - width, turns + width])
        focus = climb(here, start, np.ones(1), step_rad)
        at = direction(focus.azimuth_rad, focus.polar_rad)[None, :]
        scores = score_together([here, *beside], at, (focus.range_m,), None)
        middle, low, high = (float(each.coherence[0, 0, 0]) for each in scores)
        curvature = low - 2 * middle + high
        if curvature < 0.0:
            turns += min(max(0.5 * width * (low - high) / curvature, -width), width)
        width, step_rad = 0.5 * width, 0.5 * step_rad
    here = turned(parts, tau, turns)
    start = (focus.azimuth_rad, focus.polar_rad, focus.range_m)
    focus = climb(here.condensed(), start, np.ones(1), step_rad)
    return Drift(focus, turns, tau, here)
