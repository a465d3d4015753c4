"""A recorded log as the driver would deliver it: every record at its time, into a connector group or a socket."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from csi_bridge.dat import DatFileError, frame_offsets
from csi_bridge.feitcsi.clock import fine_us
from csi_bridge.feitcsi.log import FeitLog, is_feitcsi, parse_log
from csi_bridge.feitcsi.records import FEITCSI_CODE, HEADER_BYTES
from csi_bridge.parser import parse_body
from csi_bridge.records import CsiError, CsiRecord

_SHORTEST_SLEEP_S: Final = 0.0005


class Feeder(Protocol):
    """NetlinkFeeder, VendorEventFeeder or UnixFeeder."""

    def send(self, code: int, body: bytes) -> bool: ...

    def close(self) -> None: ...


@dataclass(frozen=True, slots=True, eq=False)
class Tape:
    """Records (code, body) of a log in file order and when each reached the host, `t_s` (N,) [s], not decreasing.

    Wall time where the driver recorded it (layouts 34 and 38, FeitCSI where the logger knew it), else the card's own
    clock from 0 on. An MPDU comes with the CSI record behind it.
    """

    path: Path
    records: tuple[tuple[int, bytes], ...]
    t_s: npt.NDArray[np.float64]
    is_wall_time: bool

    @property
    def is_feitcsi(self) -> bool:
        """Whether these are reports of an AX card."""
        return self.records[0][0] == FEITCSI_CODE

    @property
    def duration_s(self) -> float:
        return float(self.t_s[-1] - self.t_s[0]) if len(self.t_s) else 0.0

    def between(self, from_s: float, to_s: float) -> tuple[tuple[int, bytes], ...]:
        """Records with from_s <= t < to_s."""
        first, last = np.searchsorted(self.t_s, [from_s, to_s])
        return self.records[first:last]


def read_tape(path: Path) -> Tape:
    """Of whichever card, by what the file holds. Raises DatFileError for one that is no log, or has no CSI records."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DatFileError(f"{path}: {error.strerror}") from None
    if is_feitcsi(data) and (log := parse_log(data, path)).records:
        return _feitcsi_tape(log, data)
    return _connector_tape(path)


def _feitcsi_tape(log: FeitLog, data: bytes) -> Tape:
    sizes = (HEADER_BYTES + 4 * record.csi.size for record in log.records)
    records = tuple((FEITCSI_CODE, data[at : at + size]) for at, size in zip(log.offsets, sizes, strict=True))
    host_us = np.array([record.host_time_us for record in log.records], np.float64)
    is_wall = bool(np.all(host_us > 0))
    stamps = np.array([record.timestamp_low_us for record in log.records], np.uint32)
    card_us = fine_us(np.array([record.ftm_ticks for record in log.records], np.uint32), stamps)
    times = host_us if is_wall else np.concatenate([[0], np.cumsum(np.maximum(np.diff(card_us), 0))])
    return Tape(log.path, records, np.maximum.accumulate(times) * 1e-6, is_wall)


def _connector_tape(path: Path) -> Tape:
    data, frames = frame_offsets(path)
    records = tuple((data[start + 2], data[start + 3 : end]) for start, end in frames)
    stamps, host_s = np.zeros(len(records), np.uint32), np.full(len(records), np.nan)
    for number, (code, body) in enumerate(records):
        try:
            record = parse_body(code, body)
        except CsiError:
            continue
        if isinstance(record, CsiRecord):
            stamps[number] = record.timestamp_low_us
            host_s[number] = -1.0 if record.host_time_ns is None else record.host_time_ns * 1e-9
    known = np.flatnonzero(~np.isnan(host_s))
    if not len(known):
        raise DatFileError(f"{path}: no CSI records, so nothing tells when to send what")
    is_wall = bool(np.all(host_s[known] >= 0))
    if is_wall:
        times = np.maximum.accumulate(host_s[known])
    else:
        steps_us = np.diff(stamps[known]).view(np.int32).astype(np.int64)
        times = np.maximum.accumulate(np.concatenate([[0], np.cumsum(np.maximum(steps_us, 0))]) * 1e-6)
    follower = np.minimum(np.searchsorted(known, np.arange(len(records))), len(known) - 1)
    return Tape(path, records, times[follower], is_wall)


def play(
    tape: Tape, feeder: Feeder, rate: float, now_s: Callable[[], float] = time.monotonic
) -> Iterator[tuple[int, int]]:
    """Sends every record at its time, `rate` times as fast; blocks in between. Yields (records due, records taken)
    about every tenth of a second. What the receiver has no room for is lost, as with the driver."""
    start_s = now_s()
    due = taken = 0
    shown_s = start_s
    while due < len(tape.records):
        reached_s = tape.t_s[0] + (now_s() - start_s) * rate
        last = int(np.searchsorted(tape.t_s, reached_s, "right"))
        for code, body in tape.records[due:last]:
            taken += feeder.send(code, body)
        due = max(due, last)
        if now_s() - shown_s > 0.1:
            shown_s = now_s()
            yield due, taken
        if due < len(tape.records):
            time.sleep(max(_SHORTEST_SLEEP_S, (float(tape.t_s[due]) - reached_s) / rate))
    yield due, taken
