"""The channel behind a report: without what the card and the standard add.

A report is conj(gamma h): where the sender turned subcarriers (HT 40 MHz: by j above the centre) the captures show the
opposite turn, while the order of subcarriers is right (VHT 80 MHz: -1 from -64 on), and phases rise with the frequency
where a delay lets them fall. Taken as it stands it would point bearings the opposite way. Pilots and the hollows of
160 MHz hold nothing and are filled in from their neighbours, turned by what the packet's own delay turns between them.
"""

from __future__ import annotations

import cmath
import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.feitcsi.records import FeitRecord
from csi_bridge.feitcsi.tones import Tones

THIN_HZ: Final = 625_000.0
"""Spacing of a thinned channel: delays up to 1.6 us are told apart, and rooms have half of one."""

Complex = npt.NDArray[np.complex64]
Indices = npt.NDArray[np.intp]


def channel(record: FeitRecord) -> Complex:
    """h (S, n_rx, n_tx) on `record.subcarrier_hz`, phases falling with frequency for a positive delay."""
    return _rows(record).reshape(record.n_rx, record.n_tx, -1).transpose(2, 0, 1)


def thinned(record: FeitRecord) -> tuple[Complex, npt.NDArray[np.float64]]:
    """h (S', n_rx, n_tx) and its frequencies (S',) from the centre: means over 625 kHz, without the gap at 0.

    The neighbouring subcarriers of a room are all but the same; their noise is not. What is left over at the outer edge
    of each half is left out, so that all means are of as many and lie evenly.
    """
    thinning = _thinning(record.tones)
    rows = _rows(record)
    means = np.concatenate(
        [rows[:, part].reshape(len(rows), -1, len(thinning.mean)) for part in thinning.parts], axis=1
    )
    return (means @ thinning.mean).reshape(record.n_rx, record.n_tx, -1).transpose(2, 0, 1), thinning.hz


def thinned_hz(plan: Tones) -> npt.NDArray[np.float64]:
    """The frequencies (S',) of `thinned` for records of this plan."""
    return _thinning(plan).hz


def _rows(record: FeitRecord) -> Complex:
    """h (n_rx n_tx, S): by chain and stream, as the data lie, whole rows of the memory at a time."""
    filling = _filling(record.tones)
    rows: Complex = np.conj(record.csi.transpose(1, 2, 0)).reshape(-1, len(record.csi))
    if filling.turn is not None:
        rows *= filling.turn
    slope = cmath.phase(sum(complex(np.vdot(row[:-1], row[1:])) for row in rows))
    turns = np.exp(np.complex64(1j * slope) * filling.away)
    rows[:, filling.missing] = ((filling.weight * turns)[..., None] * rows.T[filling.sources]).sum(axis=0).T
    return rows


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class _Filling:
    """Positions (N,) of what is missing, and for both neighbours, (2, N): where, with what weight, how far below [in
    indices]. `turn` (S,) undoes the sender's, None where there is none."""

    turn: Complex | None
    missing: Indices
    sources: Indices
    weight: npt.NDArray[np.float32]
    away: npt.NDArray[np.float32]


@lru_cache(maxsize=32)
def _filling(plan: Tones) -> _Filling:
    measured, missing = np.flatnonzero(plan.valid), np.flatnonzero(~plan.valid)
    after = np.searchsorted(measured, missing)
    sources = np.stack([measured[after - 1], measured[after]])
    away = (plan.index[missing] - plan.index[sources]).astype(np.float32)
    weight = np.abs(away[::-1]) / np.abs(away).sum(axis=0)
    turn = plan.turn.conj() if (plan.turn != 1).any() else None
    return _Filling(turn=turn, missing=missing, sources=sources, weight=weight, away=away)


@dataclass(frozen=True, slots=True, eq=False)
class _Thinning:
    """Runs of positions that are averaged, the weights (n,) of so many at a time, and the mean frequencies (S',)."""

    parts: tuple[slice, ...]
    mean: Complex
    hz: npt.NDArray[np.float64]


@lru_cache(maxsize=32)
def _thinning(plan: Tones) -> _Thinning:
    count = round(THIN_HZ / plan.spacing_hz)
    borders = [0, *(np.flatnonzero(np.diff(plan.index) > 1) + 1).tolist(), len(plan.index)]
    parts = []
    for first, after in itertools.pairwise(borders):
        spare = (after - first) % count
        parts.append(slice(first + spare, after) if plan.index[first] < 0 else slice(first, after - spare))
    hz = np.concatenate([plan.frequency_hz[part].reshape(-1, count).mean(axis=1) for part in parts])
    hz.flags.writeable = False
    return _Thinning(tuple(parts), np.full(count, 1 / count, np.complex64), hz)
