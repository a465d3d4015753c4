"""FeitCSI records for tests: random ones of any format, and where the real captures are."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.log import FeitLog, parse_log
from csi_bridge.feitcsi.rate import Format, Rate
from csi_bridge.feitcsi.records import HEADER_BYTES, FeitRecord
from csi_bridge.feitcsi.tones import tones
from tests.paths import DATA

CAPTURES: Final = DATA / "feitcsi"
needs_captures = pytest.mark.skipif(not CAPTURES.is_dir(), reason=f"no FeitCSI captures at {CAPTURES}")
MAC = bytes.fromhex("0016ea123456")
_WIDTHS: Final = (20, 40, 80, 160)
KINDS: Final = [
    (Format.OFDM, 20),
    (Format.HT, 20),
    (Format.HT, 40),
    (Format.VHT, 40),
    (Format.VHT, 80),
    (Format.HE, 40),
]


def rate_word(kind: Format, width_mhz: int) -> int:
    return kind << 8 | _WIDTHS.index(width_mhz) << 11 | 0b11 << 14


def record(
    kind: Format = Format.HE, width_mhz: int = 80, n_rx: int = 2, n_tx: int = 1, seed: int = 0, stamp_us: int = 0
) -> FeitRecord:
    """A record with random CSI and random bytes where the header has no known meaning."""
    plan = tones(kind, width_mhz)
    assert plan is not None
    rng = np.random.default_rng(seed)
    parts = rng.integers(-300, 300, (2, len(plan.index), n_rx, n_tx))
    original = FeitRecord(
        ftm_ticks=stamp_us * 320 % 2**32,
        host_time_us=0,
        rssi_dbm=(-40, -45),
        mac=MAC,
        timestamp_low_us=stamp_us,
        rate=Rate(rate_word(kind, width_mhz)),
        csi=(parts[0] + 1j * parts[1]).astype(np.complex64),
        header=rng.bytes(HEADER_BYTES),
    )
    return replace(original, header=encode_record(original)[:HEADER_BYTES])


def write_log(path: Path, records: Iterable[FeitRecord]) -> None:
    path.write_bytes(b"".join(encode_record(record) for record in records))


def read_log(path: Path) -> FeitLog:
    return parse_log(path.read_bytes(), path)


def same(a: FeitRecord, b: FeitRecord) -> bool:
    """Every field equal, the CSI bit for bit."""
    slots = [name for name in FeitRecord.__slots__ if name != "csi"]
    return np.array_equal(a.csi, b.csi) and all(getattr(a, name) == getattr(b, name) for name in slots)


def with_field(data: bytes, at: int, layout: str, value: int) -> bytes:
    """The same bytes with one number in them replaced."""
    changed = bytearray(data)
    struct.pack_into(layout, changed, at, value)
    return bytes(changed)
