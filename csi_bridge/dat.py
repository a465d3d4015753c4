"""Log files of the 802.11n CSI Tool and of drivers patched from it, read whole and decoded in groups of one shape."""

from __future__ import annotations

import mmap
import os
import stat
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.foreign import foreign_format
from csi_bridge.parser import HEADER, LAYOUTS, body_shape
from csi_bridge.payload import payload_bytes, unpack
from csi_bridge.records import CSI_CODE, MAX_ANTENNAS, MPDU_CODE, SUBCARRIERS, CsiError, row_antennas

Shape = tuple[int, int, int]
"""layout, n_rx, n_tx"""
_SHAPE_BYTES: Final = np.array([0, 1, 2, 11, 12, 19, 20])
"""Of a record in a file: length, code, n_rx, n_tx, payload length."""
_DECODED_AT_ONCE: Final = 2048
"""Records: what is worked on stays in the processor's cache."""
_MAX_CSI_BODY: Final = LAYOUTS[-1] + payload_bytes(MAX_ANTENNAS, MAX_ANTENNAS)


_MAPPED_BYTES: Final = 32 << 20
"""Files beyond are mapped and their pages given back as they are gone through, instead of read whole."""
_SELECTED_AT_ONCE: Final = 65536
_NEIGHBOURS: Final = 300
_CSI_BYTE: Final = bytes([CSI_CODE])
Content = bytes | mmap.mmap


class DatFileError(ValueError):
    """The file cannot be read as a CSI log; the message names it."""


@dataclass(frozen=True, slots=True, eq=False)
class CsiLog:
    """All CSI records of a log, N of them, in file order."""

    path: Path
    csi: npt.NDArray[np.complex64]
    """(N, 30, antennas, max n_tx), receive antennas A, B, C up to the last one used; zero for those a record lacks."""
    layout: npt.NDArray[np.uint8]
    n_rx: npt.NDArray[np.uint8]
    n_tx: npt.NDArray[np.uint8]
    timestamp_low_us: npt.NDArray[np.uint32]
    bfee_count: npt.NDArray[np.uint16]
    rssi: npt.NDArray[np.uint8]
    """(N, 3), antennas A, B, C in dB before AGC."""
    noise_dbm: npt.NDArray[np.int8]
    agc: npt.NDArray[np.uint8]
    rate: npt.NDArray[np.uint16]
    host_time_s: npt.NDArray[np.float64]
    """Wall time of the host; nan in layout 20."""
    mac: npt.NDArray[np.str_]
    """Sender as `00:21:6A:53:89:D2`; empty in layout 20."""
    frame_count: npt.NDArray[np.int64]
    """-1 in layouts 20 and 34."""
    mpdu_count: int
    unknown_count: int
    """Records of other codes."""
    malformed_count: int
    """Records whose lengths contradict each other, or what follows them."""
    skipped_bytes: int
    """Passed over to find the next record where a length could not be trusted."""
    truncated_bytes: int
    """Of a record cut off by the end of the file: normal, the logger writes whole pages."""
    left_out_count: int = 0
    """Sound CSI records that were not wanted."""
    left_out_s: tuple[float, float] | None = None
    """First and last host time of those."""

    def __len__(self) -> int:
        return len(self.layout)


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which records to keep, so that memory goes by what is used; a few neighbours are kept with those of a time. A
    record without a host time or counter is kept."""

    time_s: tuple[float, float] | None = None
    """First and last host time."""
    counters: tuple[int, int] | None = None
    """First and last frame counter."""


@dataclass(frozen=True, slots=True)
class _Run:
    """Records of one shape, one behind the other: where the first begins, bytes of each with its length, how many."""

    shape: Shape
    first: int
    size: int
    count: int

    @property
    def end(self) -> int:
        return self.first + self.size * self.count


@dataclass(slots=True, eq=False)
class _Frames:
    groups: dict[Shape, list[tuple[int, npt.NDArray[np.intp]]]] = field(default_factory=lambda: defaultdict(list))
    """(number of the first record, offsets of the bodies) of each run of records of one shape."""
    records: int = 0
    runs: list[_Run] = field(default_factory=list)
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


def read_dat(path: str | Path, wanted: Wanted | None = None) -> CsiLog:
    """All records, or those `wanted`. Raises DatFileError for a file that is missing, unreadable, empty or no CSI
    log."""
    path = Path(path)
    data = _content(path)
    frames = _sound_frames(path, data)
    array = np.frombuffer(data, np.uint8)
    if wanted is not None:
        _keep(array, frames, wanted, _release_of(data))
    return _decode(path, array, frames, frames.records, _release_of(data))


def frame_offsets(path: str | Path) -> tuple[Content, npt.NDArray[np.int64]]:
    """The file's bytes, and (N, 2) where each sound frame of it, CSI or other, begins and ends. Raises as
    `read_dat`."""
    data = _content(Path(path))
    frames = _sound_frames(Path(path), data)
    begins = [run.first + run.size * np.arange(run.count, dtype=np.int64) for run in frames.runs]
    ends = [begin + run.size for begin, run in zip(begins, frames.runs, strict=True)]
    others = np.array(frames.others, np.int64).reshape(-1, 2)
    offsets = np.stack([np.concatenate([*begins, others[:, 0]]), np.concatenate([*ends, others[:, 1]])], axis=1)
    return data, offsets[np.argsort(offsets[:, 0], kind="stable")]


def _sound_frames(path: Path, data: Content) -> _Frames:
    frames = _frames(data)
    # One CSI record is proof enough, so many lengths agree in it; an MPDU record is but one byte that fits.
    if frames.records == 0 and frames.mpdu <= frames.malformed + frames.unknown:
        what = foreign_format(data[:4096])
        seen = f"{f'{what}; ' if what else ''}{frames.records} CSI records in {len(data)} bytes"
        raise DatFileError(f"{path}: not a CSI log ({seen}); expected one of the Intel 5300's CSI tool")
    return frames


def _content(path: Path) -> Content:
    try:
        with path.open("rb") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise DatFileError(f"{path}: not a file, expected a CSI log")
            size = os.fstat(file.fileno()).st_size
            data = mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ) if size > _MAPPED_BYTES else file.read()
    except OSError as error:
        raise DatFileError(f"{path}: {error.strerror}") from None
    if not data:
        raise DatFileError(f"{path}: empty file")
    return data


def _release_of(data: Content) -> Callable[[], None]:
    """Gives pages of a mapped file back: they are read again where they are needed again."""
    if isinstance(data, bytes):
        return lambda: None
    return lambda: data.madvise(mmap.MADV_DONTNEED)


def _keep(data: npt.NDArray[np.uint8], frames: _Frames, wanted: Wanted, release: Callable[[], None]) -> None:
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
        host_s = _column(rows, 20, "<u4") + _column(rows, 24, "<u4") * 1e-6
        if wanted.time_s is not None:
            kept &= (host_s >= wanted.time_s[0]) & (host_s <= wanted.time_s[1])
    if wanted.counters is not None and layout == 38:
        counters = _column(rows, 34, "<u4")
        kept &= (counters >= wanted.counters[0]) & (counters <= wanted.counters[1])
    return host_s, kept


def _with_neighbours(kept: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """And some on either side: what is far off by its time may have come right after, by a clock that was set."""
    widened = kept.copy()
    for edge in np.unique((np.flatnonzero(np.diff(kept)) + 1) // _NEIGHBOURS) * _NEIGHBOURS:
        widened[max(0, edge - _NEIGHBOURS) : edge + 2 * _NEIGHBOURS] = True
    return widened


def _frames(data: Content) -> _Frames:
    """Goes from length to length; where one leads to no record, on to the next CSI record there is."""
    view, found = memoryview(data), _Frames()
    array = np.frombuffer(data, np.uint8)
    release = _release_of(data)
    runs: list[_Run] = []
    start = released = 0
    while len(view) - start > 2:
        if start - released > _MAPPED_BYTES:
            release()
            released = start
        end = _end(view, start)
        shape = _csi_shape(view, start)
        if shape is not None:
            # Logs are long runs of records of one shape: the first shows it, the others are compared with it at once.
            runs.append(_Run(shape, start, end - start, _repeats(array, start, end - start, release)))
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


def _search(data: Content, start: int, runs: list[_Run]) -> tuple[int, int]:
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


def _decode(
    path: Path, data: npt.NDArray[np.uint8], frames: _Frames, count: int, release: Callable[[], None]
) -> CsiLog:
    max_tx = max((n_tx for _, _, n_tx in frames.groups), default=1)
    header = np.zeros((count, 38), np.uint8)
    layouts = np.zeros(count, np.uint8)
    csi = np.zeros((count, SUBCARRIERS, MAX_ANTENNAS, max_tx), np.complex64)
    antennas = 1
    for (layout, n_rx, n_tx), runs in frames.groups.items():
        for first, offset in runs:
            for start in range(0, len(offset), _DECODED_AT_ONCE):
                part = offset[start : start + _DECODED_AT_ONCE]
                at = slice(first + start, first + start + len(part))
                layouts[at] = layout
                used = _decode_run(data, part, (layout, n_rx, n_tx), header[at], csi[at])
                antennas = max(antennas, used)
                release()
    stamped = layouts >= 34
    return CsiLog(
        path=path,
        csi=np.ascontiguousarray(csi[:, :, :antennas]),
        layout=layouts,
        n_rx=header[:, 8],
        n_tx=header[:, 9],
        timestamp_low_us=_column(header, 0, "<u4").astype(np.uint32),
        bfee_count=_column(header, 4, "<u2").astype(np.uint16),
        rssi=header[:, 10:13],
        noise_dbm=header[:, 13].view(np.int8),
        agc=header[:, 14],
        rate=_column(header, 18, "<u2").astype(np.uint16),
        host_time_s=np.where(stamped, _column(header, 20, "<u4") + _column(header, 24, "<u4") * 1e-6, np.nan),
        mac=_macs(header[:, 28:34], stamped),
        frame_count=np.where(layouts == 38, _column(header, 34, "<u4").astype(np.int64), -1),
        mpdu_count=frames.mpdu,
        unknown_count=frames.unknown,
        malformed_count=frames.malformed,
        skipped_bytes=frames.skipped_bytes,
        truncated_bytes=frames.truncated_bytes,
        left_out_count=frames.left_out,
        left_out_s=frames.left_out_s,
    )


def _decode_run(
    data: npt.NDArray[np.uint8],
    offset: npt.NDArray[np.intp],
    shape: Shape,
    header: npt.NDArray[np.uint8],
    csi: npt.NDArray[np.complex64],
) -> int:
    """Fills header (N, 38) and csi (N, 30, 3, n_tx) from bodies at `offset`, evenly spaced; how many antennas exist."""
    layout, n_rx, n_tx = shape
    size = payload_bytes(n_rx, n_tx)
    step = int(offset[1] - offset[0]) if len(offset) > 1 else layout + size
    bodies = np.lib.stride_tricks.as_strided(data[offset[0] :], (len(offset), layout + size), (step, 1))
    header[:, :layout] = bodies[:, :layout]
    values = unpack(bodies[:, layout:], n_rx, n_tx)
    antennas = 1
    for selection in np.unique(header[:, 15]):
        chosen = np.flatnonzero(header[:, 15] == selection)
        order = row_antennas(int(selection), n_rx)
        antennas = max(antennas, max(order) + 1)
        rows = slice(None) if len(chosen) == len(offset) else chosen
        if n_rx == MAX_ANTENNAS:
            csi[rows, :, :, :n_tx] = np.take(values[rows], np.argsort(order), axis=2)
        else:
            for row, antenna in enumerate(order):
                csi[rows, :, antenna, :n_tx] = values[rows, :, row]
    return antennas


def _column(header: npt.NDArray[np.uint8], at: int, dtype: str) -> npt.NDArray[np.unsignedinteger]:
    size = np.dtype(dtype).itemsize
    column: npt.NDArray[np.unsignedinteger] = np.ascontiguousarray(header[:, at : at + size]).view(dtype)[:, 0]
    return column


def _macs(rows: npt.NDArray[np.uint8], stamped: npt.NDArray[np.bool_]) -> npt.NDArray[np.str_]:
    if not len(rows):
        return np.zeros(0, "<U17")
    # As one number each: sorting those is ten times as fast as sorting rows.
    wide = np.zeros((len(rows), 8), np.uint8)
    wide[:, 2:] = rows
    unique, inverse = np.unique(wide.view(">u8")[:, 0].astype(np.uint64), return_inverse=True)
    names = np.array([int(mac).to_bytes(6, "big").hex(":").upper() for mac in unique], dtype="<U17")
    return np.where(stamped, names[inverse], "").astype("<U17")
