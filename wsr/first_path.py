"""The path that comes first, by the delays that a wide band resolves: one value per packet instead of a spectrum.

Over B Hz paths c / B apart are told by their delays, 7.9 m over 40 MHz, 3.9 m over 80 and 1.9 m over 160. What comes
later can then be left out before any direction is looked for: echoes bias a bearing, break the chain of signs, and hide
a path that something stands in front of.

1. A packet's own detection delay is random, and the centroid of its power is no fixed mark where echoes fade. So the
   packets are shifted until their impulse responses lie on each other: each to the highest correlation of its amplitude
   profile with the mean of all, some rounds of that.
2. The mean power over delays has its first maximum, or where paths melt into one lump the rise of its leading edge,
   where the first path is.
3. The value of a packet is its response there, or rather somewhat earlier: on the rising flank of a Hann lobe the first
   path is weaker by some 14 dB, and one that comes 2 to 4 m later by twice as much and more. As early as noise allows.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wsr.ofdm import Grid

LEAST_HZ = 30e6
"""Over 20 MHz paths lie 15 m apart before they are told, which is more than most rooms have."""
_EARLIEST_S, _LATEST_S = -90e-9, 170e-9
_REACH_S = 45e-9
_STEPS_A_LOBE = 3
_ROUNDS = 5
_SETTLED = 0.03
"""Of a step: shifts that are all smaller are the last."""
_LEAST_DB = -15.0
"""A maximum that is lower, against the highest, is a side lobe or nothing that a bearing could be made of."""
_EDGE_DB = -6.0
_EARLY = 1.3
"""Lobes are 4 / B wide; so many 1 / B before its maximum the value is taken."""
_ABOVE_NOISE_DB = 10.0
_QUIETEST = 0.1

Array = NDArray[np.float64]
Complex64 = NDArray[np.complex64]


def is_wide(grid: Grid) -> bool:
    """Whether delays over this band tell a room's paths apart."""
    return grid.bandwidth_hz >= LEAST_HZ


def first_path(channel: Complex64, grid: Grid) -> Complex64:
    """(M, 1) of channels (M, S) on `grid`, about their power centroids: the first path's value in each packet, as they
    were scaled. Phases stay those at the channel centre."""
    responses = _responses(grid)
    shift_s = _shifts(channel, responses)
    aligned = channel * np.exp(2j * math.pi * shift_s[:, None] * grid.hz).astype(np.complex64)
    power = np.square(np.median(np.abs(aligned @ responses.hann), axis=0))
    late_s = _taken_at(10 * np.log10(np.maximum(power, 1e-30)), responses)
    weights = responses.taper * np.exp(2j * math.pi * grid.hz * late_s)
    return np.ascontiguousarray((aligned @ weights.astype(np.complex64))[:, None])


class _Responses:
    """From channels (M, S) to responses (M, D) at delays `at_s` (D,): with the wide lobe of a Hann taper, and with the
    narrower one of a cosine, which alignment takes."""

    def __init__(self, grid: Grid) -> None:
        lobe_s = 1 / grid.bandwidth_hz
        self.step_s: float = lobe_s / _STEPS_A_LOBE
        self.lobe_s: float = lobe_s
        self.at_s: Array = self.step_s * np.arange(math.ceil(_EARLIEST_S / self.step_s), _LATEST_S / self.step_s)
        across = grid.hz / (1.02 * grid.bandwidth_hz)
        cosine = np.cos(math.pi * across)
        self.taper = cosine**2 / (cosine**2).sum()
        waves = np.exp(2j * math.pi * grid.hz[:, None] * self.at_s)
        self.cosine = (cosine[:, None] / cosine.sum() * waves).astype(np.complex64)
        self.hann = (self.taper[:, None] * waves).astype(np.complex64)
        off_s = np.linspace(0.0, 2.0 * lobe_s, 201)
        lobe = np.abs(self.taper @ np.exp(2j * math.pi * grid.hz[:, None] * off_s))
        self.edge_s = float(off_s[np.argmax(20 * np.log10(np.maximum(lobe, 1e-9)) < _EDGE_DB)])
        """From the maximum of one path to where its rise is at `_EDGE_DB`."""


_responses = lru_cache(maxsize=4)(_Responses)


def _shifts(channel: Complex64, responses: _Responses) -> Array:
    """Seconds (M,) that each packet comes late against the others."""
    reach = math.ceil(_REACH_S / responses.step_s)
    total_s, rows = np.zeros(len(channel)), np.arange(len(channel))
    profile = np.sqrt(np.abs(channel @ responses.cosine))
    size = profile.shape[1]
    # What a shift leaves beyond the ends is as quiet as the noise there.
    positions = np.arange(size, dtype=np.float64)
    moved = profile
    for _ in range(_ROUNDS):
        loudness = np.maximum(np.linalg.norm(moved, axis=1, keepdims=True), np.float32(1e-12))
        mean = np.sqrt(np.square(moved / loudness).mean(axis=0))
        padded = np.pad(mean, reach)
        templates = np.stack([padded[reach - s : reach - s + size] for s in range(-reach, reach + 1)], axis=1)
        match = moved @ templates.astype(np.float32)
        at = np.clip(np.argmax(match, axis=1), 1, 2 * reach - 1)
        before, top, behind = match[rows, at - 1], match[rows, at], match[rows, at + 1]
        bend = np.minimum(before - 2 * top + behind, -1e-12)
        steps = at - reach + np.clip(0.5 * (before - behind) / bend, -0.5, 0.5)
        total_s += steps * responses.step_s
        moved = _moved(profile, positions, total_s / responses.step_s)
        if np.abs(steps - np.median(steps)).max() < _SETTLED:
            break
    return total_s


def _moved(profile: NDArray[np.float32], positions: Array, steps: Array) -> NDArray[np.float32]:
    """Amplitudes (M, D), each row read so many steps later."""
    at = np.clip(positions + steps[:, None], 0, len(positions) - 1.001)
    low = at.astype(np.intp)
    share = (at - low).astype(np.float32)
    rows = np.arange(len(profile))[:, None]
    return np.asarray((1 - share) * profile[rows, low] + share * profile[rows, low + 1])


def _taken_at(power_db: Array, responses: _Responses) -> float:
    """The delay at which values are taken, from mean powers (D,) over delays."""
    at_s, step_s = responses.at_s, responses.step_s
    floor_db = float(np.quantile(power_db, _QUIETEST))
    least_db = max(float(power_db.max()) + _LEAST_DB, floor_db + _ABOVE_NOISE_DB)
    inner = power_db[1:-1]
    peaks = 1 + np.flatnonzero((inner >= power_db[:-2]) & (inner > power_db[2:]) & (inner >= least_db))
    first = int(peaks[0]) if len(peaks) else int(np.argmax(power_db))
    edge_db, below = power_db[first] + _EDGE_DB, first
    while below > 0 and power_db[below] > edge_db:
        below -= 1
    rise = max(float(power_db[below + 1] - power_db[below]), 1e-9) if below < first else 1.0
    edge_s = float(at_s[below]) + step_s * min(max((edge_db - float(power_db[below])) / rise, 0.0), 1.0)
    path_s = min(float(at_s[first]), edge_s + responses.edge_s)
    heard = np.flatnonzero((at_s <= path_s) & (power_db < floor_db + _ABOVE_NOISE_DB))
    quiet_s = float(at_s[heard[-1]]) + step_s if len(heard) else float(at_s[0])
    return float(min(max(path_s - _EARLY * responses.lobe_s, quiet_s), path_s))
