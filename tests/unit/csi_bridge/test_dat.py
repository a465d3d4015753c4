"""Log files: against csiread where it is right (layout 20), and on real layout-34 and layout-38 captures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from csi_bridge.dat import read_dat
from csi_bridge.encoder import encode_file_record
from csi_bridge.records import MPDU_CODE, CsiRecord
from tests.csi_records import log_of, needs_data, parsed, read_with_csiread, record
from tests.paths import DATA

STOCK_SAMPLES = {
    "sample_0x1_ap.dat": (540, 0),
    "sample_0x5_64_3000.dat": (2998, 2998),
    "los_100.dat": (1377, 0),
    "log.all_csi.6.7.6": (29, 0),
}
RX, TX2, TX3, TX4 = "00:21:6A:53:89:D2", "00:21:6A:3F:17:5A", "00:21:6A:30:D2:3C", "00:21:6A:B2:6E:FA"


@needs_data
@pytest.mark.parametrize("name", STOCK_SAMPLES)
def test_agrees_with_csiread_bit_for_bit(name: str) -> None:
    log = read_dat(DATA / "csi_samples" / name)
    oracle = read_with_csiread(log.path, *log.csi.shape[2:])
    assert (len(log), log.mpdu_count) == STOCK_SAMPLES[name]
    assert set(log.layout.tolist()) == {20}
    assert np.array_equal(log.csi, oracle.csi)
    pairs: list[tuple[npt.ArrayLike, npt.ArrayLike]] = [
        (log.n_rx, oracle.Nrx),
        (log.n_tx, oracle.Ntx),
        (log.timestamp_low_us, oracle.timestamp_low),
        (log.bfee_count, oracle.bfee_count),
        (log.rssi, np.stack([oracle.rssi_a, oracle.rssi_b, oracle.rssi_c], axis=1)),
        (log.noise_dbm, oracle.noise),
        (log.agc, oracle.agc),
        (log.rate, oracle.rate),
    ]
    for ours, theirs in pairs:
        assert np.array_equal(ours, theirs)


@needs_data
def test_receiver_of_layout_38_hears_three_senders() -> None:
    log = read_dat(DATA / "wsr_dataset_dev/LOS_Set_A/0627_2D-multi-link_A_L2/csi_rx_2021-06-27_203220.dat")
    assert log.csi.shape == (4693, 30, 3, 1)
    assert set(log.layout.tolist()) == {38}
    macs, counts = np.unique(log.mac, return_counts=True)
    assert dict(zip(macs.tolist(), counts.tolist(), strict=True)) == {TX3: 1565, TX2: 1564, TX4: 1564}
    # Truncated by the logger's page size, and nothing else is wrong with it.
    assert (log.truncated_bytes, log.malformed_count, log.unknown_count, log.mpdu_count) == (163, 0, 0, 0)
    amplitude = np.abs(log.csi).mean(axis=(0, 1, 3))
    assert amplitude[0] > 10 and amplitude[1:].max() < 4


@needs_data
def test_both_ends_of_layout_38_count_the_same_exchanges() -> None:
    folder = DATA / "wsr_dataset_dev/LOS_Set_A/0627_2D-multi-link_A_L2"
    receiver = read_dat(folder / "csi_rx_2021-06-27_203220.dat")
    for name, mac in {"tx2": TX2, "tx3": TX3, "tx4": TX4}.items():
        other = read_dat(folder / f"csi_{name}_2021-06-27_203220.dat")
        assert set(other.mac.tolist()) == {RX}
        assert other.csi.shape == (1564, 30, 3, 1)
        counters = receiver.frame_count[receiver.mac == mac]
        assert np.all(np.diff(counters) > 0)
        assert len(np.intersect1d(counters, other.frame_count)) > 1500
        host_rate = np.polyfit(other.timestamp_low_us * 1e-6, other.host_time_s - other.host_time_s[0], 1)[0]
        assert host_rate == pytest.approx(1, abs=2e-4)


@needs_data
def test_layout_34_has_stamps_but_no_counter() -> None:
    log = read_dat(DATA / "wsr_3d/3D_1_RX_2_TX_formation_2/3D_TX_dataset_csi_rx_tx/csi_rx_2021-03-03_212146.dat")
    assert log.csi.shape == (2557, 30, 3, 1)
    assert set(log.layout.tolist()) == {34}
    assert {mac: int(np.sum(log.mac == mac)) for mac in set(log.mac.tolist())} == {TX3: 1192, "00:21:6A:3E:F5:7E": 1365}
    assert set(log.frame_count.tolist()) == {-1}
    assert 1_614_824_480 < log.host_time_s.min() < log.host_time_s.max() < 1_614_824_500


@needs_data
def test_every_real_log_reads_cleanly() -> None:
    paths = sorted(DATA.glob("wsr_*/**/*.dat"))
    assert len(paths) > 100
    for path in paths:
        log = read_dat(path)
        assert len(log) > 1000 and log.malformed_count == log.unknown_count == 0, path
        assert log.truncated_bytes < 256, path


def test_group_decoding_equals_the_parser_record_by_record(tmp_path: Path) -> None:
    shapes = [(3, 1, 38), (2, 1, 20), (3, 2, 34), (1, 1, 38), (3, 1, 38), (3, 3, 20), (2, 1, 20)]
    records = [record(n_rx, n_tx, layout, seed) for seed, (n_rx, n_tx, layout) in enumerate(shapes)]
    content = encode_file_record(MPDU_CODE, b"frame") + log_of(records)
    path = tmp_path / "mixed.dat"
    path.write_bytes(content + encode_file_record(0x42, b"other") + log_of(records)[:30])
    log = read_dat(path)
    assert (len(log), log.mpdu_count, log.unknown_count, log.truncated_bytes) == (7, 1, 1, 30)
    number = 0
    for _, one in parsed(content):
        if isinstance(one, CsiRecord):
            rows = log.csi[number][:, list(one.antennas), : one.n_tx]
            assert np.array_equal(rows, one.csi)
            assert np.count_nonzero(log.csi[number]) == np.count_nonzero(one.csi)
            assert log.layout[number] == one.layout
            assert log.frame_count[number] == (-1 if one.frame_count is None else one.frame_count)
            assert log.mac[number] == ("" if one.mac is None else one.mac.hex(":").upper())
            number += 1
    assert number == 7
