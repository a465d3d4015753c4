"""Peaks of a profile, on its grid."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wsr.directions import Peak, Profile
from wsr.geometry import angles, direction, great_circle
from wsr.relief import prominences, width_rad

MIN_SEPARATION_RAD = math.radians(10.0)

Array = NDArray[np.float64]


def find_peaks(profile: Profile, count: int, min_separation_rad: float = MIN_SEPARATION_RAD) -> tuple[Peak, ...]:
    """The highest local maxima of a profile, at most `count`, highest first, pairwise `min_separation_rad` apart.

    The grid is a sphere: its first and last columns are neighbours, and over a pole lies the column half a turn away.
    """
    rows, columns = np.nonzero(_local_maxima(profile.power))
    powers = profile.power[rows, columns].astype(np.float64)
    order = np.argsort(powers)[::-1]
    units = direction(profile.azimuth_rad[columns], profile.polar_rad[rows])
    near_one = np.zeros(powers.size, np.bool_)
    kept: list[Peak] = []
    # On half the resolution: saddles are as wide as lobes.
    relief = prominences(_pooled(profile.power))
    for index in order:
        if len(kept) == count or powers[index] <= 0.0:
            break
        if near_one[index]:
            continue
        row, column = int(rows[index]), int(columns[index])
        # Of equal neighbours any one may carry the prominence.
        r, c = row // 2, column // 2
        near = relief[max(r - 1, 0) : r + 2, np.arange(c - 1, c + 2) % relief.shape[1]]
        kept.append(
            Peak(
                azimuth_rad=float(profile.azimuth_rad[column]),
                polar_rad=float(profile.polar_rad[row]),
                power=float(powers[index]),
                relative_power=float(powers[index] / powers[order[0]]),
                prominence=float(near.max()),
                width_rad=width_rad(profile.power, row, column),
            )
        )
        near_one |= great_circle(units[index], units) < min_separation_rad
    return tuple(kept)


def mirrored(peak: Peak, normal: Array) -> Peak:
    """The same peak seen in the mirror plane through the origin with this unit normal (3,)."""
    u = direction(peak.azimuth_rad, peak.polar_rad)
    azimuth, polar = angles(u - 2.0 * (u @ normal) * normal)
    return replace(peak, azimuth_rad=float(azimuth), polar_rad=float(polar))


def _pooled(power: NDArray[np.float32]) -> NDArray[np.float32]:
    """Maxima over blocks of two by two, of an even number of rows."""
    # Not of a reshaped block: that takes fifteen times as long.
    higher = np.maximum(power[0::2], power[1::2])
    return np.asarray(np.maximum(higher[:, 0::2], higher[:, 1::2]))


def _local_maxima(power: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Grid points (T, P) not below any of their eight neighbours."""
    half = power.shape[1] // 2
    padded = np.vstack([np.roll(power[:1], half, axis=1), power, np.roll(power[-1:], half, axis=1)])
    padded = np.hstack([padded[:, -1:], padded, padded[:, :1]])
    beside = np.maximum(np.maximum(padded[:, :-2], padded[:, 2:]), padded[:, 1:-1])
    around = np.maximum(np.maximum(beside[:-2], beside[2:]), beside[1:-1])
    return np.asarray(power >= around)
