"""A recorded log as the driver would deliver it: every record at its time, into a connector group or a socket."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol, overload

import numpy as np
import numpy.typing as npt

from csi_bridge.clock import median_of_five
from csi_bridge.dat_frames import Content, DatFileError, content, offsets, sound_frames
from csi_bridge.feitcsi.log import FeitLog, is_feitcsi, parse_log
from csi_bridge.feitcsi.parser import sender_of
from csi_bridge.feitcsi.records import FEITCSI_CODE, HEADER_BYTES
from csi_bridge.parser import HEADER, STAMP, body_shape, parse_head
from csi_bridge.records import CSI_CODE, CsiError
from csi_bridge.regular_file import open_regular

_SHORTEST_SLEEP_S: Final = 0.0005
_DISAGREE_S: Final = 0.5
_FIRST_BYTES: Final = 1 << 16
"""More than the largest report of an AX card, so that damage at the beginning does not hide one."""


class Feeder(Protocol):
    """NetlinkFeeder, VendorEventFeeder or UnixFeeder."""

    def send(self, code: int, body: bytes) -> bool: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Tape:
    """Records (code, body) of a log in file order and when each reached the host, `t_s` (N,) [s], not decreasing.

    Wall time where the driver recorded it (layouts 34 and 38, FeitCSI where the logger knew it), else the card's own
    clock from 0 on. An MPDU comes with the CSI record behind it.
    """

    path: Path
    records: Sequence[tuple[int, bytes]]
    t_s: npt.NDArray[np.float64]
    due_s: npt.NDArray[np.float64]
    """(N,) when to send each, from 0 on, spaced by the card's clock: the host's may have been set meanwhile."""
    malformed_count: int = 0
    """Records that could not be read, and are left out."""
    skipped_bytes: int = 0

    @property
    def is_feitcsi(self) -> bool:
        """Whether these are reports of an AX card."""
        return self.records[0][0] == FEITCSI_CODE

    @property
    def duration_s(self) -> float:
        return float(self.due_s[-1]) if len(self.due_s) else 0.0

    def senders(self) -> frozenset[str]:
        """MACs that its CSI records name."""
        found = {_sender(code, body) for code, body in self.records}
        return frozenset(mac.hex(":").upper() for mac in found if mac is not None)

    def between(self, from_s: float, to_s: float) -> Sequence[tuple[int, bytes]]:
        """Records with from_s <= t < to_s."""
        first, last = np.searchsorted(self.t_s, [from_s, to_s])
        return self.records[first:last]


def read_tape(path: Path) -> Tape:
    """Of whichever card, by what the file holds. Raises DatFileError for one that is no log, or has no CSI records."""
    try:
        with open_regular(path) as file:
            data = file.read(_FIRST_BYTES)
            if is_feitcsi(data):
                data += file.read()
    except OSError as error:
        raise DatFileError(f"{path}: {error.strerror}") from None
    if not is_feitcsi(data):
        return _connector_tape(path)
    if (log := parse_log(data, path)).records:
        return _feitcsi_tape(log, data)
    try:
        return _connector_tape(path)
    except DatFileError:
        raise DatFileError(log.without_record) from None


def _feitcsi_tape(log: FeitLog, data: bytes) -> Tape:
    sizes = (HEADER_BYTES + 4 * record.csi.size for record in log.records)
    records = tuple((FEITCSI_CODE, data[at : at + size]) for at, size in zip(log.offsets, sizes, strict=True))
    host_s = np.array([record.host_time_us for record in log.records], np.float64) * 1e-6
    stamps = np.array([record.timestamp_low_us for record in log.records], np.uint32)
    is_wall = bool(np.all(host_s > 0))
    due_s = _spaced(stamps, host_s if is_wall else None)
    times = np.maximum.accumulate(host_s) if is_wall else due_s
    return Tape(
        path=log.path,
        records=records,
        t_s=times,
        due_s=due_s,
        malformed_count=log.damaged_count,
        skipped_bytes=log.skipped_bytes,
    )


def _connector_tape(path: Path) -> Tape:
    data = content(path)
    frames = sound_frames(path, data)
    records = _Records(data, offsets(frames))
    stamps, host_s = np.zeros(len(records), np.uint32), np.full(len(records), np.nan)
    for number, (code, body) in enumerate(records):
        if code != CSI_CODE:
            continue
        try:
            layout, _, _ = body_shape(body)
        except CsiError:
            continue
        stamps[number] = HEADER.unpack_from(body)[0]
        seconds, microseconds, _ = STAMP.unpack_from(body, HEADER.size) if layout > HEADER.size else (-1, 0, b"")
        host_s[number] = seconds + microseconds * 1e-6
    known = np.flatnonzero(~np.isnan(host_s))
    if not len(known):
        raise DatFileError(f"{path}: no CSI records, so nothing tells when to send what")
    is_wall = bool(np.all(host_s[known] >= 0))
    due_s = _spaced(stamps[known], host_s[known] if is_wall else None)
    times = np.maximum.accumulate(host_s[known]) if is_wall else due_s
    follower = np.minimum(np.searchsorted(known, np.arange(len(records))), len(known) - 1)
    return Tape(
        path=path,
        records=records,
        t_s=times[follower],
        due_s=due_s[follower],
        malformed_count=frames.malformed,
        skipped_bytes=frames.skipped_bytes,
    )


def _sender(code: int, body: bytes) -> bytes | None:
    try:
        if code == FEITCSI_CODE:
            return sender_of(body)
        return parse_head(body).mac if code == CSI_CODE else None
    except CsiError:
        return None


class _Records(Sequence[tuple[int, bytes]]):
    """Records of a log, each cut out when it is asked for: a file may be larger than what it is used for."""

    def __init__(self, data: Content, frames: npt.NDArray[np.int64]) -> None:
        self._data = data
        self._frames = frames

    def __len__(self) -> int:
        return len(self._frames)

    @overload
    def __getitem__(self, index: int) -> tuple[int, bytes]: ...

    @overload
    def __getitem__(self, index: slice) -> _Records: ...

    def __getitem__(self, index: int | slice) -> tuple[int, bytes] | _Records:
        if isinstance(index, slice):
            return _Records(self._data, self._frames[index])
        start, end = self._frames[index].tolist()
        return self._data[start + 2], self._data[start + 3 : end]


def _spaced(stamps_us: npt.NDArray[np.uint32], host_s: npt.NDArray[np.float64] | None) -> npt.NDArray[np.float64]:
    """(N,) from 0 on by the card's clock. Where it and the host's disagree by more than half a second, one of them was
    set or reset, and the lesser step counts; alone, a single wrong stamp moves nothing behind it."""
    # A difference of uint32 wraps as the counter does; read as int32 it is signed.
    card_s = np.diff(stamps_us).view(np.int32).astype(np.float64) * 1e-6
    if host_s is None:
        reached_s = median_of_five(np.concatenate([[0.0], np.cumsum(card_s)]))
        card_s = np.diff(reached_s)
    else:
        wall_s = np.diff(host_s)
        differ = np.abs(card_s - wall_s) > _DISAGREE_S
        card_s = np.where(differ, np.minimum(np.maximum(card_s, 0.0), np.maximum(wall_s, 0.0)), card_s)
    return np.concatenate([[0.0], np.cumsum(np.maximum(card_s, 0.0))])


def play(
    tape: Tape, feeder: Feeder, rate: float, now_s: Callable[[], float] = time.monotonic
) -> Iterator[tuple[int, int]]:
    """Sends every record at its time, `rate` times as fast; blocks in between. Yields (records due, records taken)
    about every tenth of a second. What the receiver has no room for is lost, as with the driver."""
    start_s = now_s()
    due = taken = 0
    shown_s = start_s
    while due < len(tape.records):
        reached_s = (now_s() - start_s) * rate
        last = int(np.searchsorted(tape.due_s, reached_s, "right"))
        for code, body in tape.records[due:last]:
            taken += feeder.send(code, body)
        due = max(due, last)
        if now_s() - shown_s > 0.1:
            shown_s = now_s()
            yield due, taken
        if due < len(tape.records):
            time.sleep(max(_SHORTEST_SLEEP_S, (float(tape.due_s[due]) - reached_s) / rate))
    yield due, taken
