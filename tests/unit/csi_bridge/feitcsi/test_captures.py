"""The eight public captures: whole, as their names say, and equal to a plain reading of their bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
import pytest

from csi_bridge.feitcsi.channel import channel, thinned
from csi_bridge.feitcsi.clock import fine_us, unwrapped_us
from csi_bridge.feitcsi.log import FeitLog, is_feitcsi, read_log, write_log
from csi_bridge.feitcsi.rate import Format
from tests.feit_records import CAPTURES, MAC, needs_captures

EXPECTED: Final = {
    "HESU160_5500": (26, Format.HE, 160, 1992),
    "HESU20_5500": (28, Format.HE, 20, 242),
    "HESU80_5500": (28, Format.HE, 80, 996),
    "HT20_2452": (48, Format.HT, 20, 56),
    "HT40_2452": (34, Format.HT, 40, 114),
    "VHT160_5500": (35, Format.VHT, 160, 484),
    "VHT20_5500": (28, Format.VHT, 20, 56),
    "VHT80_5500": (40, Format.VHT, 80, 242),
}
pytestmark = [needs_captures, pytest.mark.parametrize("name", sorted(EXPECTED))]


def capture(name: str) -> FeitLog:
    return read_log(CAPTURES / f"{name}.csi")


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


def test_pilots_hold_nothing_and_are_filled_in(name: str) -> None:
    for record in capture(name).records:
        plan = record.tones
        pilots = ~plan.valid if plan.index[-1] * plan.spacing_hz < 60e6 else ~plan.valid & (record.csi[:, 0, 0] == 0)
        assert not record.csi[pilots].any()
        filled = np.abs(channel(record))
        assert filled.min() > 0.1 * np.median(filled)


def test_phases_go_on_evenly_over_the_gap_at_the_centre_and_where_the_sender_turned(name: str) -> None:
    log = capture(name)
    plan = log.records[0].tones
    h = np.array([channel(record)[:, 0, 0] for record in log.records])
    step = np.diff(plan.index)
    products = h[:, 1:] * h[:, :-1].conj()
    slope = np.angle(products[:, step == 1].sum())
    assert slope < 0, "a delay lets phases fall with the frequency"
    off = np.angle(products.mean(axis=0) * np.exp(-1j * slope * step))
    assert np.abs(off).max() < 0.3


def test_thinned_channels_are_625_khz_apart_and_follow_the_whole_one(name: str) -> None:
    record = capture(name).records[0]
    thin, hz = thinned(record)
    assert thin.shape == (len(hz), 2, 1)
    gaps = np.diff(hz)
    assert np.isclose(gaps, 625e3).mean() > 0.95 and gaps.min() > 624e3
    whole = channel(record)[:, 1, 0]
    between = np.interp(hz, record.subcarrier_hz, whole.real) + 1j * np.interp(hz, record.subcarrier_hz, whole.imag)
    assert np.abs(thin[:, 1, 0] - between).max() < 0.15 * np.abs(whole).max()


def test_both_clocks_agree_to_a_few_microseconds(name: str) -> None:
    records = capture(name).records
    stamps = np.array([record.timestamp_low_us for record in records], np.uint32)
    ticks = np.array([record.ftm_ticks for record in records], np.uint32)
    off = fine_us(ticks, stamps) - unwrapped_us(stamps)
    assert np.ptp(off) < 4.5
    assert (np.diff(fine_us(ticks, stamps)) > 0).all()
