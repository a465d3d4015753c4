"""Of a log only what is wanted is kept, so that memory goes by that and not by the file."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.dat_frames import Frames, Shape, column

_SELECTED_AT_ONCE: Final = 65536
_NEIGHBOURS: Final = 300


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which records to keep, so that memory goes by what is used; a few neighbours are kept with those of a time. A
    record without a host time or counter is kept."""

    time_s: tuple[float, float] | None = None
    """First and last host time."""
    counters: tuple[int, int] | None = None
    """First and last frame counter."""


def keep(data: npt.NDArray[np.uint8], frames: Frames, wanted: Wanted, release: Callable[[], None]) -> None:
    """Leaves in `frames` only the records that are wanted, in stretches of neighbours."""
    runs = sorted((first, shape, at) for shape, found in frames.groups.items() for first, at in found)
    host_s = np.full(frames.records, np.nan)
    kept = np.ones(frames.records, np.bool_)
    for first, shape, offsets in runs:
        for start in range(0, len(offsets), _SELECTED_AT_ONCE):
            part = offsets[start : start + _SELECTED_AT_ONCE]
            here = slice(first + start, first + start + len(part))
            host_s[here], kept[here] = _looked_at(data, part, shape, wanted)
            release()
    if wanted.time_s is not None:
        kept = _with_neighbours(kept)
    left = ~kept
    frames.left_out = int(np.count_nonzero(left))
    left &= np.isfinite(host_s)
    if np.any(left):
        first_s, last_s = np.min(host_s, where=left, initial=np.inf), np.max(host_s, where=left, initial=-np.inf)
        frames.left_out_s = float(first_s), float(last_s)
    frames.groups, frames.records = defaultdict(list), 0
    for first, shape, offsets in runs:
        chosen = np.flatnonzero(kept[first : first + len(offsets)])
        for stretch in np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1):
            if len(stretch):
                frames.groups[shape].append((frames.records, offsets[stretch]))
                frames.records += len(stretch)


def _looked_at(
    data: npt.NDArray[np.uint8], offsets: npt.NDArray[np.intp], shape: Shape, wanted: Wanted
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.bool_]]:
    """Host times (N,), nan in layout 20, of records whose bodies are at `offsets`, evenly spaced; which are wanted."""
    layout = shape[0]
    step = int(offsets[1] - offsets[0]) if len(offsets) > 1 else layout
    rows = np.lib.stride_tricks.as_strided(data[offsets[0] :], (len(offsets), layout), (step, 1))
    host_s, kept = np.full(len(offsets), np.nan), np.ones(len(offsets), np.bool_)
    if layout >= 34:
        host_s = column(rows, 20, "<u4") + column(rows, 24, "<u4") * 1e-6
        if wanted.time_s is not None:
            kept &= (host_s >= wanted.time_s[0]) & (host_s <= wanted.time_s[1])
    if wanted.counters is not None and layout == 38:
        counters = column(rows, 34, "<u4")
        kept &= (counters >= wanted.counters[0]) & (counters <= wanted.counters[1])
    return host_s, kept


def _with_neighbours(kept: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """And some on either side: what is far off by its time may have come right after, by a clock that was set."""
    widened = kept.copy()
    for edge in np.unique((np.flatnonzero(np.diff(kept)) + 1) // _NEIGHBOURS) * _NEIGHBOURS:
        widened[max(0, edge - _NEIGHBOURS) : edge + 2 * _NEIGHBOURS] = True
    return widened
