"""Bins along the path, so that every stretch of it has the same weight, however slowly it was travelled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wsr.machine_code import compiled

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Bins:
    """p_m (B, 3) mean positions, channel (B, S) mean channels, counts (B,) packets, segment (B,) of the chain of signs,
    weights (M,) of the packets: 1 / count of their bin, 0 where dropped."""

    p_m: Array
    channel: Complex
    counts: NDArray[np.int64]
    segment: NDArray[np.int64]
    weights: Array

    def means(self, values: NDArray[np.floating]) -> Array:
        """Mean (B,) over each bin of one value per packet (M,)."""
        used = np.flatnonzero(self.weights)
        starts = np.cumsum(self.counts) - self.counts
        return np.asarray(np.add.reduceat((values * self.weights)[used], starts))


def path_bins(
    p_m: Array,
    channel: NDArray[np.complexfloating],
    keep: NDArray[np.bool_],
    segment: NDArray[np.int64],
    *,
    length_m: float | None,
) -> Bins:
    """Means over runs of kept packets that stay within `length_m` of the run's first, or of single packets if None.

    A run never spans two segments. The noise of a standing robot, which would otherwise be most of the aperture, is
    averaged here, coherently.
    """
    used = np.flatnonzero(keep)
    p, h, part = p_m[used], channel[used], segment[used]
    run = np.arange(used.size) if length_m is None else np.zeros(used.size, np.int64)
    if length_m is not None:
        _runs(np.ascontiguousarray(p), length_m, run)
    starts = np.flatnonzero((np.diff(run, prepend=-1) != 0) | (np.diff(part, prepend=-1) != 0))
    borders = np.append(starts, used.size)
    counts = np.diff(borders)
    weights = np.zeros(len(p_m))
    weights[used] = np.repeat(1.0 / counts, counts)
    mean_p, mean_h = np.zeros((starts.size, 3)), np.zeros((starts.size, h.shape[1]), np.complex128)
    parts = np.ascontiguousarray(h, np.complex64).view(np.float32)
    _average(np.ascontiguousarray(p), parts, borders, mean_p, mean_h.view(np.float64))
    return Bins(
        p_m=mean_p,
        channel=mean_h,
        counts=counts,
        segment=part[starts],
        weights=weights,
    )


@compiled
def _runs(p_m: Array, length_m: float, run: NDArray[np.int64]) -> None:
    first = 0
    for i in range(1, run.size):
        far = 0.0
        for axis in range(3):
            far += (p_m[i, axis] - p_m[first, axis]) * (p_m[i, axis] - p_m[first, axis])
        run[i] = run[i - 1]
        if far > length_m * length_m:
            first = i
            run[i] += 1


@compiled
def _average(
    p_m: Array, parts: NDArray[np.float32], starts: NDArray[np.int64], mean_p: Array, mean_parts: Array
) -> None:
    """Means over the packets from each start up to the next, into zeros; the end comes last of the starts."""
    for b in range(mean_p.shape[0]):
        share = 1.0 / (starts[b + 1] - starts[b])
        for i in range(starts[b], starts[b + 1]):
            for axis in range(3):
                mean_p[b, axis] += p_m[i, axis] * share
            for s in range(parts.shape[1]):
                mean_parts[b, s] += parts[i, s] * share
