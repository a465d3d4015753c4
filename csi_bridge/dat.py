"""Log files of the 802.11n CSI Tool and of drivers patched from it, read whole and decoded in groups of one shape."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from csi_bridge.dat_frames import Frames, Shape, column, content, release_of, sound_frames
from csi_bridge.dat_wanted import Wanted, keep
from csi_bridge.payload import payload_bytes, unpack
from csi_bridge.records import MAX_ANTENNAS, SUBCARRIERS, row_antennas

_DECODED_AT_ONCE: Final = 2048
"""Records: what is worked on stays in the processor's cache."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
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
    subcarrier_hz: npt.NDArray[np.float64] | None = None
    """(S,) from the channel's centre, where the records are an AX card's: `csi` then is (N, S, 2, 1), thinned, and each
    chain's sign is random (docs/cards.md)."""
    fine_us: npt.NDArray[np.float64] | None = None
    """(N,) unwrapped times on such a card's own clock, to 3.125 ns."""
    other_kinds: Mapping[str, int] = field(default_factory=dict)
    """Records of an AX card that are of another format or width than most, and left out."""

    def __len__(self) -> int:
        return len(self.layout)


def read_dat(path: str | Path, wanted: Wanted | None = None) -> CsiLog:
    """All records, or those `wanted`. Raises DatFileError for a file that is missing, unreadable, empty or no CSI
    log."""
    path = Path(path)
    data = content(path)
    frames = sound_frames(path, data)
    array = np.frombuffer(data, np.uint8)
    if wanted is not None:
        keep(array, frames, wanted, release_of(data))
    return _decode(path, array, frames, frames.records, release=release_of(data))


def _decode(
    path: Path, data: npt.NDArray[np.uint8], frames: Frames, count: int, *, release: Callable[[], None]
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
                used = _decode_run(data, part, (layout, n_rx, n_tx), header[at], csi=csi[at])
                antennas = max(antennas, used)
                release()
    stamped = layouts >= 34
    return CsiLog(
        path=path,
        csi=np.ascontiguousarray(csi[:, :, :antennas]),
        layout=layouts,
        n_rx=header[:, 8],
        n_tx=header[:, 9],
        timestamp_low_us=column(header, 0, "<u4").astype(np.uint32),
        bfee_count=column(header, 4, "<u2").astype(np.uint16),
        rssi=header[:, 10:13],
        noise_dbm=header[:, 13].view(np.int8),
        agc=header[:, 14],
        rate=column(header, 18, "<u2").astype(np.uint16),
        host_time_s=np.where(stamped, column(header, 20, "<u4") + column(header, 24, "<u4") * 1e-6, np.nan),
        mac=_macs(header[:, 28:34], stamped),
        frame_count=np.where(layouts == 38, column(header, 34, "<u4").astype(np.int64), -1),
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
    *,
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


def _macs(rows: npt.NDArray[np.uint8], stamped: npt.NDArray[np.bool_]) -> npt.NDArray[np.str_]:
    if not len(rows):
        return np.zeros(0, "<U17")
    # As one number each: sorting those is ten times as fast as sorting rows.
    wide = np.zeros((len(rows), 8), np.uint8)
    wide[:, 2:] = rows
    unique, inverse = np.unique(wide.view(">u8")[:, 0].astype(np.uint64), return_inverse=True)
    names = np.array([int(mac).to_bytes(6, "big").hex(":").upper() for mac in unique], dtype="<U17")
    return np.where(stamped, names[inverse], "").astype("<U17")
