"""Stretches of a path: places with their own steering vectors, the snapshots over subcarriers, and fits to them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wsr.errors import ApertureError
from wsr.path_bins import Bins

# From so many on, stretches overlap less, down to not at all, to save time.
_MANY_STRETCHES = 32
MIN_PLACES = 4

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """p_waves (p, 3) places in wavelengths of the phase; snapshots (p, S); of their covariance the eigenvalues (p,),
    largest first, and the eigenvectors (p, p) as columns."""

    p_waves: Array
    snapshots: Complex
    eigenvalues: Array
    eigenvectors: Complex


def cut(bins: Bins, elements: int, wave_m: float) -> list[Stretch]:
    """Stretches of `elements` places, each half over the next; fewer only where the path has no more.

    A stretch never spans two segments, whose signs do not belong together. Raises ApertureError where no segment has
    at least 4 places.
    """
    total = len(bins.counts)
    step = min(max(elements // 2, math.ceil(total / _MANY_STRETCHES)), elements)
    stretches = []
    for number in np.unique(bins.segment):
        members = np.flatnonzero(bins.segment == number)
        size = min(elements, len(members))
        if size < MIN_PLACES:
            continue
        count = 1 + math.ceil((len(members) - size) / step)
        for start in np.linspace(0, len(members) - size, count).round().astype(np.int64):
            stretches.append(_stretch(bins, members[start : start + size], wave_m))
    if not stretches:
        raise ApertureError(
            f"aperture has {total} places in {len(np.unique(bins.segment))} pieces between jumps; "
            f"needs a piece of at least {MIN_PLACES}"
        )
    return stretches


def likeness(stretches: list[Stretch], u: Array, v: Array) -> float:
    """|a(u)^H a(v)|^2 / p^2, mean over stretches: 1 where the aperture cannot tell u and v."""
    return float(np.mean([abs(np.exp(2j * np.pi * (s.p_waves @ (u - v))).mean()) ** 2 for s in stretches]))


def path_powers(stretches: list[Stretch], directions: Array) -> Array:
    """Share (n,) of the energy that each of the directions (n, 3) has when all are fitted together, by least squares
    within each stretch and subcarrier. One path alone, coherent in every stretch, has 1."""
    power = np.zeros(len(directions))
    total = 0.0
    for stretch in stretches:
        steering = np.exp(2j * np.pi * (stretch.p_waves @ directions.T))
        amplitude = np.linalg.lstsq(steering, stretch.snapshots, rcond=1e-3)[0]
        energy = float(np.real(np.vdot(stretch.snapshots, stretch.snapshots)))
        power += len(steering) * (np.abs(amplitude) ** 2).sum(axis=1) / energy
        total += 1.0
    # Paths that hardly differ in a stretch get more than there is, in opposite phase.
    return np.asarray(power / max(total, float(power.sum())))


def left_over(stretches: list[Stretch], directions: Array) -> float:
    """Share of the energy, mean over stretches, that paths from the directions (n, 3) together do not explain."""
    left = 0.0
    for stretch in stretches:
        steering = np.exp(2j * np.pi * (stretch.p_waves @ directions.T))
        amplitude = np.linalg.lstsq(steering, stretch.snapshots, rcond=1e-3)[0]
        rest = stretch.snapshots - steering @ amplitude
        left += float(np.vdot(rest, rest).real / max(np.vdot(stretch.snapshots, stretch.snapshots).real, 1e-300))
    return left / len(stretches)


def whole_coherence(bins: Bins, u: Array, wave_m: float) -> float:
    """F in 0..1 of all bins as one aperture towards u (3,), power added over subcarriers; pieces of a broken chain of
    signs are joined as they add up, largest first."""
    turned = bins.channel * np.exp(-2j * np.pi / wave_m * (bins.p_m @ u))[:, None]
    pieces = np.add.reduceat(turned, np.flatnonzero(np.diff(bins.segment, prepend=-1)), axis=0)
    total = np.zeros(turned.shape[1], np.complex128)
    for piece in pieces[np.argsort(-np.linalg.norm(pieces, axis=1))]:
        total = total + (piece if np.vdot(total, piece).real >= 0 else -piece)
    energy = float(np.vdot(turned, turned).real)
    return float(np.vdot(total, total).real) / (len(turned) * energy) if energy > 0.0 else 0.0


def _stretch(bins: Bins, members: NDArray[np.int64], wave_m: float) -> Stretch:
    p_waves = bins.p_m[members] / wave_m
    snapshots = bins.channel[members]
    values, vectors = np.linalg.eigh(snapshots @ snapshots.conj().T / snapshots.shape[1])
    return Stretch(p_waves - p_waves.mean(axis=0), snapshots, np.maximum(values[::-1], 0.0), vectors[:, ::-1])
