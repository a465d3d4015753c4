"""FeitCSI logs in the shape that recordings are joined in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from csi_bridge.dat_frames import DatFileError
from csi_bridge.dat_wanted import Wanted
from csi_bridge.feitcsi.channel import thinned
from csi_bridge.feitcsi.csi_log import is_feitcsi_file, read_csi_log
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.rate import Format
from tests.feit_records import record, write_log


def test_a_log_is_read_thinned_with_its_powers_and_clocks(tmp_path: Path) -> None:
    path = tmp_path / "both.csi"
    stamps_us = [(2**32 - 2000 + 1000 * n) % 2**32 for n in range(5)]
    records = [replace(record(seed=us, stamp_us=us), rssi_dbm=(-40, -60)) for us in stamps_us]
    write_log(path, [*records, record(Format.HT, 20)])
    assert is_feitcsi_file(path)
    log = read_csi_log(path)
    assert (len(log), log.csi.shape, log.other_kinds) == (5, (5, 124, 2, 1), {"HT 20 MHz": 1})
    assert np.isnan(log.host_time_s).all()
    assert log.fine_us is not None and np.allclose(np.diff(log.fine_us), 1000, atol=0.01)
    csi, hz = thinned(records[3])
    assert log.subcarrier_hz is not None and np.array_equal(log.subcarrier_hz, hz)
    assert np.allclose(log.csi[3, :, 0, 0], csi[:, 0, 0])
    assert np.allclose(log.csi[3, :, 1, 0], csi[:, 1, 0] / 10, rtol=1e-5)


def test_only_the_wanted_time_is_kept_and_damage_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "log.csi"
    bodies = [
        encode_record(replace(record(Format.HT, 20, seed=n, stamp_us=n), host_time_us=(100 + n) * 1_000_000))
        for n in range(6)
    ]
    path.write_bytes(b"".join([*bodies[:4], b"x" * 700, *bodies[4:], bodies[0][:300]]))
    log = read_csi_log(path, Wanted((102.0, 104.0)))
    assert log.host_time_s.tolist() == [102.0, 103.0, 104.0]
    assert (log.left_out_count, log.left_out_s, log.truncated_bytes) == (3, (100.0, 105.0), 300)
    assert (log.malformed_count, log.skipped_bytes) == (1, 700)


def test_what_is_no_log_is_named(tmp_path: Path) -> None:
    (tmp_path / "not.csi").write_bytes(bytes(5000))
    assert not is_feitcsi_file(tmp_path / "not.csi")
    assert not is_feitcsi_file(tmp_path / "none.csi")
    for name in ("not.csi", "none.csi"):
        with pytest.raises(DatFileError, match=name):
            read_csi_log(tmp_path / name)
