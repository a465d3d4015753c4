"""Profiles on the one-degree grid from coarser looks, and the peaks of a look at circles."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wsr.directions import AZIMUTH_RAD, POLAR_RAD, ROWS, Peak, Profile
from wsr.focus import Look
from wsr.kernel import bartlett_power
from wsr.peaks import MIN_SEPARATION_RAD
from wsr.relief import prominences, width_rad

_TAU = 2 * math.pi

Array = NDArray[np.float64]


def look_profile(seen: Look) -> Profile:
    """The look's best score over ranges, 1 at its maximum, interpolated along and between its rows."""
    counts = np.diff(seen.rows)
    at, share = _along(tuple(counts.tolist()))
    power = seen.power
    table = power[at[0]] * (1.0 - share) + power[at[1]] * share
    polar = seen.polar_rad[seen.rows[:-1]]
    place = np.interp(POLAR_RAD, polar, np.arange(polar.size))
    low = np.minimum(place.astype(np.intp), polar.size - 2)
    weight = (place - low)[:, None]
    return Profile(((1 - weight) * table[low] + weight * table[low + 1]).astype(np.float32), AZIMUTH_RAD, POLAR_RAD)


@lru_cache(maxsize=4)
def _along(counts: tuple[int, ...]) -> tuple[NDArray[np.intp], Array]:
    """Directions (2, T, P) on both sides of each azimuth of the profile, in rows of so many even azimuths from -pi on,
    and the share (T, P) of the second."""
    number = np.array(counts)[:, None]
    place = (AZIMUTH_RAD + math.pi) / _TAU * number
    low = np.minimum(place.astype(np.intp), number - 1)
    first = np.cumsum(number, axis=0) - number
    return np.stack([first + low, first + (low + 1) % number]), place - low


def level_profile(x_m: Array, channel: NDArray[np.complex128], wavelength_m: float) -> Profile:
    """Far-field power, 1 at its maximum, of channels (B,) at x (B, 3), computed every other degree and interpolated.

    Lobes are as wide as the wavelength over the aperture, some degrees.
    """
    scale = float(np.abs(channel).sum()) or 1.0
    coarse = bartlett_power(x_m / wavelength_m, channel / scale, ROWS // 2)
    # Rows of the coarse grid lie between two of the fine one, columns on every other one.
    half = coarse.shape[1] // 2
    padded = np.vstack([np.roll(coarse[:1], half, axis=1), coarse, np.roll(coarse[-1:], half, axis=1)])
    power = np.empty((ROWS, 2 * ROWS), np.float32)
    power[0::2, 0::2] = np.float32(0.75) * coarse + np.float32(0.25) * padded[:-2]
    power[1::2, 0::2] = np.float32(0.75) * coarse + np.float32(0.25) * padded[2:]
    power[:, 1::2] = np.float32(0.5) * (power[:, 0::2] + np.roll(power[:, 0::2], -1, axis=1))
    return Profile(power / max(power.max(), np.float32(1e-30)), AZIMUTH_RAD, POLAR_RAD)


def ring_peaks(seen: Look, count: int) -> tuple[Peak, ...]:
    """The highest peaks of a look at full circles, by azimuth alone, at the polar angle of the best; at least one."""
    circles = seen.power.reshape(len(seen.rows) - 1, -1)
    polars = seen.polar_rad[seen.rows[:-1]]
    ring, best = circles.max(axis=0).astype(np.float32), polars[circles.argmax(axis=0)]
    azimuth = seen.azimuth_rad[: ring.size]
    relief = prominences(ring[None, :])[0]
    tops = np.flatnonzero((ring >= np.roll(ring, 1)) & (ring >= np.roll(ring, -1)))
    kept: list[int] = []
    for top in tops[np.argsort(-ring[tops], kind="stable")]:
        if len(kept) == count:
            break
        apart = np.abs(np.remainder(azimuth[top] - azimuth[kept] + math.pi, _TAU) - math.pi)
        if np.all(apart >= MIN_SEPARATION_RAD):
            kept.append(int(top))
    return tuple(
        Peak(
            azimuth_rad=float(azimuth[k]),
            polar_rad=float(best[k]),
            power=float(ring[k]),
            relative_power=float(ring[k] / ring.max()),
            prominence=float(relief[k]),
            width_rad=width_rad(ring[None, :], 0, k),
        )
        for k in kept
    )
