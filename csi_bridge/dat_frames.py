"""Frames of a log of the 802.11n CSI Tool: where each begins and ends, however damaged the file is.

A frame is a u16 big-endian length of code and body, a u8 code and the body.
"""

from __future__ import annotations

import mmap
import os
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.foreign import foreign_format
from csi_bridge.parser import HEADER, LAYOUTS, body_shape
from csi_bridge.payload import payload_bytes
from csi_bridge.records import CSI_CODE, MAX_ANTENNAS, MPDU_CODE, CsiError
from csi_bridge.regular_file import open_regular

Content = bytes | mmap.mmap
Shape = tuple[int, int, int]
"""layout, n_rx, n_tx"""
_SHAPE_BYTES: Final = np.array([0, 1, 2, 11, 12, 19, 20])
"""Of a record in a file: length, code, n_rx, n_tx, payload length."""
_MAX_CSI_BODY: Final = LAYOUTS[-1] + payload_bytes(MAX_ANTENNAS, MAX_ANTENNAS)
_MAPPED_BYTES: Final = 32 << 20
"""Files beyond are mapped and their pages given back as they are gone through, instead of read whole."""
_CSI_BYTE: Final = bytes([CSI_CODE])


class DatFileError(ValueError):
    """The file cannot be read as a CSI log; the message names it."""


@dataclass(frozen=True, slots=True)
class RecordRun:
    """Records of one shape, one behind the other: where the first begins, bytes of each with its length, how many."""

    shape: Shape
    first: int
    size: int
    count: int

    @property
    def end(self) -> int:
        return self.first + self.size * self.count


@dataclass(slots=True, eq=False, kw_only=True)
class Frames:
    groups: dict[Shape, list[tuple[int, npt.NDArray[np.intp]]]] = field(default_factory=lambda: defaultdict(list))
    """(number of the first record, offsets of the bodies) of each run of records of one shape."""
    records: int = 0
    runs: list[RecordRun] = field(default_factory=list)
    others: list[tuple[int, int]] = field(default_factory=list)
    """Where each frame of another code begins and ends."""
    left_out: int = 0
    left_out_s: tuple[float, float] | None = None
    mpdu: int = 0
    unknown: int = 0
    malformed: int = 0
    skipped_bytes: int = 0
    truncated_bytes: int = 0

    def count(self, code: int, start: int, end: int) -> None:
        """One more frame that is no sound CSI record."""
        if code != CSI_CODE:
            self.others.append((start, end))
        self.malformed += code == CSI_CODE
        self.mpdu += code == MPDU_CODE
        self.unknown += code not in (CSI_CODE, MPDU_CODE)


def offsets(frames: Frames) -> npt.NDArray[np.int64]:
    """(N, 2) where each sound frame, CSI or other, begins and ends, in order."""
    begins = [run.first + run.size * np.arange(run.count, dtype=np.int64) for run in frames.runs]
    ends = [begin + run.size for begin, run in zip(begins, frames.runs, strict=True)]
    others = np.array(frames.others, np.int64).reshape(-1, 2)
    found = np.stack([np.concatenate([*begins, others[:, 0]]), np.concatenate([*ends, others[:, 1]])], axis=1)
    return np.asarray(found[np.argsort(found[:, 0], kind="stable")])


def sound_frames(path: Path, data: Content) -> Frames:
    """Raises DatFileError where `data` is no CSI log; the message names `path`."""
    frames = _find(data)
    # One CSI record is proof enough, so many lengths agree in it; an MPDU record is but one byte that fits.
    if frames.records == 0 and frames.mpdu <= frames.malformed + frames.unknown:
        what = foreign_format(data[:4096])
        seen = f"{f'{what}; ' if what else ''}{frames.records} CSI records in {len(data)} bytes"
        raise DatFileError(f"{path}: not a CSI log ({seen}); expected one of the Intel 5300's CSI tool or of FeitCSI")
    return frames


def content(path: Path) -> Content:
    try:
        with open_regular(path) as file:
            size = os.fstat(file.fileno()).st_size
            data = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ) if size > _MAPPED_BYTES else file.read()
    except OSError as error:
        raise DatFileError(f"{path}: {error.strerror}") from None
    if not data:
        raise DatFileError(f"{path}: empty file")
    return data


def release_of(data: Content) -> Callable[[], None]:
    """Gives pages of a mapped file back: they are read again where they are needed again."""
    if isinstance(data, bytes):
        return lambda: None
    return lambda: data.madvise(mmap.MADV_DONTNEED)


def _find(data: Content) -> Frames:
    """Goes from length to length; where one leads to no record, on to the next CSI record there is."""
    view, found = memoryview(data), Frames()
    array = np.frombuffer(data, np.uint8)
    release = release_of(data)
    runs: list[RecordRun] = []
    start = released = 0
    while len(view) - start > 2:
        if start - released > _MAPPED_BYTES:
            release()
            released = start
        end = _end(view, start)
        shape = _csi_shape(view, start)
        if shape is not None:
            # Logs are long runs of records of one shape: the first shows it, the others are compared with it at once.
            runs.append(RecordRun(shape, start, end - start, _repeats(array, start, end - start, release)))
            start = runs[-1].end
        elif _leads_on(view, end):
            found.count(view[start + 2] if end - start > 2 else CSI_CODE, start, end)
            start = end
        elif end > len(view) and _leads_on(view, start) and _next_csi(data, start + 1) == len(view):
            break  # cut off by the end of the file
        else:
            start, resumed = _search(data, start, runs)
            found.malformed += 1
            found.skipped_bytes += resumed - start
            start = resumed
    found.truncated_bytes = len(view) - start
    found.runs = runs
    for run in runs:
        found.groups[run.shape].append((found.records, run.first + 3 + run.size * np.arange(run.count)))
        found.records += run.count
    return found


def _repeats(data: npt.NDArray[np.uint8], start: int, size: int, release: Callable[[], None]) -> int:
    """How many records from `start` on are like the first: same length, code, antennas and payload length."""
    count, chunk = 1, 8
    while available := min(chunk, (len(data) - start) // size - count):
        at = start + size * count
        rows = data[at : at + available * size].reshape(available, size)[:, _SHAPE_BYTES]
        differs = np.flatnonzero((rows != data[start + _SHAPE_BYTES]).any(axis=1))
        if len(differs):
            return count + int(differs[0])
        count += available
        chunk = 4096
        release()
    return count


def _end(view: memoryview, start: int) -> int:
    return start + 2 + (view[start] << 8 | view[start + 1])


def _csi_shape(view: memoryview, start: int) -> Shape | None:
    """Shape of a sound and whole CSI record at `start`: so many lengths agree in it that it is no accident."""
    end = _end(view, start)
    if view[start + 2] != CSI_CODE or end > len(view):
        return None
    try:
        return body_shape(view[start + 3 : end])
    except CsiError:
        return None


def _is_cut_csi(view: memoryview, start: int) -> bool:
    """Whether what is there of a record that the file's end cuts off is sound."""
    size = _end(view, start) - start - 3
    body = bytes(view[start + 3 :])
    if len(body) < HEADER.size:
        return size <= _MAX_CSI_BODY
    try:
        body_shape(body.ljust(size, b"\0"))
    except CsiError:
        return False
    return True


def _search(data: Content, start: int, runs: list[RecordRun]) -> tuple[int, int]:
    """Where the damage at `start` begins and where the next record does, or the file ends.

    It may have begun in the record before, whose length was then wrong in a way that it agreed with all others: that is
    shown by a record that begins inside it, or by its layout, and it is taken out.
    """
    view = memoryview(data)
    if not runs or runs[-1].end != start:
        return start, _next_csi(data, start + 1)
    last = runs[-1]
    before, shape = last.end - last.size, last.shape
    earlier = shape if last.count > 1 else runs[-2].shape if len(runs) > 1 else None
    resumed = _next_csi(data, before + 1)
    neighbour = _csi_shape(view, resumed) if resumed < len(view) else earlier or shape
    if resumed < start or (neighbour is not None and neighbour[0] != shape[0]):
        runs[-1:] = [replace(last, count=last.count - 1)] if last.count > 1 else []
        return before, resumed
    return start, resumed


def _next_csi(data: Content, start: int) -> int:
    """Where the first CSI record at or behind `start` is; the length of `data` where there is none."""
    view, at = memoryview(data), start
    while (code_at := data.find(_CSI_BYTE, at + 2)) >= 0:
        at = code_at - 2
        if _csi_shape(view, at) is not None:
            return at
        at += 1
    return len(data)


def _leads_on(view: memoryview, start: int, frames: int = 2) -> bool:
    """Whether frames of known codes stand at `start`, or the file ends there. One code alone may be an accident."""
    if len(view) - start < 3:
        return start <= len(view)
    end = _end(view, start)
    code = view[start + 2]
    if code == CSI_CODE and end > start + 2:
        return _csi_shape(view, start) is not None or (end > len(view) and _is_cut_csi(view, start))
    if frames == 0 or end > len(view):
        return code == MPDU_CODE and end > start + 2
    return _leads_on(view, end, frames - 1)


def column(header: npt.NDArray[np.uint8], at: int, dtype: str) -> npt.NDArray[np.unsignedinteger]:
    size = np.dtype(dtype).itemsize
    column: npt.NDArray[np.unsignedinteger] = np.ascontiguousarray(header[:, at : at + size]).view(dtype)[:, 0]
    return column
