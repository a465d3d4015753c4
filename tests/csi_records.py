"""CSI records for tests: a plain one, random ones, and where the real captures are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from csi_bridge.dat_frames import offsets, sound_frames
from csi_bridge.encoder import encode_body, encode_file_record
from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, CsiRecord, MpduRecord
from tests.paths import DATA

MAC = bytes.fromhex("00216a3f175a")

needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no real captures at {DATA}")


def record(n_rx: int = 3, n_tx: int = 1, layout: int = 38, seed: int = 0, frame_count: int = 7) -> CsiRecord:
    """A record with random CSI; fields that its layout lacks are None."""
    parts = np.random.default_rng(seed).integers(-128, 128, (2, 30, n_rx, n_tx))
    plain = CsiRecord(
        timestamp_low_us=4_000_000_000,
        bfee_count=65_535,
        n_rx=n_rx,
        n_tx=n_tx,
        rssi=(40, 33, 0),
        noise_dbm=-92,
        agc=38,
        antenna_sel=0b00_10_01,
        rate=0x4101,
        csi=(parts[0] + 1j * parts[1]).astype(np.complex64),
        layout=20,
    )
    if layout == 20:
        return plain
    stamped = replace(plain, layout=layout, host_time_ns=1_624_840_302_123_456_000, mac=MAC)
    return replace(stamped, frame_count=frame_count) if layout == 38 else stamped


def same(a: CsiRecord, b: CsiRecord) -> bool:
    """Every field equal, the CSI bit for bit."""
    slots = [name for name in CsiRecord.__slots__ if name != "csi"]
    return np.array_equal(a.csi, b.csi) and all(getattr(a, name) == getattr(b, name) for name in slots)


def log_of(records: Iterable[CsiRecord]) -> bytes:
    """A whole log file of CSI records."""
    return b"".join(encode_file_record(CSI_CODE, encode_body(record)) for record in records)


def read_with_csiread(path: Path, n_rx: int, n_tx: int) -> Any:
    """A layout-20 log as csiread reads it, whose field names these are; skips where it has no wheel."""
    oracle = pytest.importorskip("csiread").Intel(str(path), nrxnum=n_rx, ntxnum=n_tx, pl_size=0, if_report=False)
    oracle.read()
    return oracle


def parsed(data: bytes) -> list[tuple[int, CsiRecord | MpduRecord]]:
    """Where each record of a log begins, and the record. Raises DatFileError for what is no log."""
    found = []
    for start, end in offsets(sound_frames(Path("log"), data)):
        record = parse_body(data[start + 2], data[start + 3 : end])
        if record is not None:
            found.append((int(start), record))
    return found
