"""The public captures: whole, as their names say, and equal to a plain reading of their bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from csi_bridge.feitcsi.log import is_feitcsi
from tests.feit_records import CAPTURES, MAC, write_log
from tests.unit.csi_bridge.feitcsi.captures import EACH, EXPECTED, capture

pytestmark = EACH


def plainly(data: bytes) -> list[tuple[npt.NDArray[np.complex128], list[int]]]:
    """CSI (S, n_rx, n_tx) and fields of each record, by what is known of the layout."""
    found, at = [], 0
    while at < len(data):
        head = np.frombuffer(data, "<u4", 68, at)
        n_rx, n_tx, size = data[at + 46], data[at + 47], int(head[0])
        parts = np.frombuffer(data, "<i2", size // 2, at + 272).reshape(n_rx, n_tx, int(head[13]), 2).astype(float)
        csi = (parts[..., 0] + 1j * parts[..., 1]).transpose(2, 0, 1)
        found.append((csi, [int(head[2]), -int(head[15]), -int(head[16]), int(head[22]), int(head[23])]))
        at += 272 + size
    return found


def test_every_record_is_what_the_name_says(name: str) -> None:
    count, kind, width_mhz, subcarriers = EXPECTED[name]
    log = capture(name)
    assert len(log) == count
    assert (log.damaged_count, log.skipped_bytes, log.truncated_bytes) == (0, 0, 0)
    for record in log.records:
        assert (record.rate.format, record.rate.width_mhz, record.csi.shape) == (kind, width_mhz, (subcarriers, 2, 1))
        assert (record.antennas, record.mac, record.host_time_us) == ((0, 1), MAC, 0)
        assert len(record.subcarrier_hz) == subcarriers
        assert np.ptp(record.subcarrier_hz) < width_mhz * 1e6


def test_values_are_those_of_a_plain_reading(name: str) -> None:
    plain = plainly((CAPTURES / f"{name}.csi").read_bytes())
    for record, (csi, fields) in zip(capture(name).records, plain, strict=True):
        assert np.array_equal(record.csi, csi)
        read = [record.ftm_ticks, *record.rssi_dbm, record.timestamp_low_us, record.rate.word]
        assert read == fields


def test_written_again_it_is_the_same_file(name: str, tmp_path: Path) -> None:
    write_log(tmp_path / "again.csi", capture(name).records)
    assert (tmp_path / "again.csi").read_bytes() == (CAPTURES / f"{name}.csi").read_bytes()


def test_content_tells_the_format_and_damage_in_front_does_not_hide_it(name: str) -> None:
    data = (CAPTURES / f"{name}.csi").read_bytes()
    assert is_feitcsi(data)
    assert is_feitcsi(b"lost" * 25 + data)
    assert not is_feitcsi(data[:90])
