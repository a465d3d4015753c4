"""Log files: against csiread where it is right (layout 20), and on real layout-34 and layout-38 captures."""

from __future__ import annotations

from pathlib import Path

import csiread
import numpy as np
import numpy.typing as npt
import pytest

from csi_bridge.dat import CsiLog, read_dat
from csi_bridge.dat_frames import DatFileError
from csi_bridge.encoder import encode_body, encode_file_record
from csi_bridge.records import CSI_CODE, MPDU_CODE, CsiRecord
from tests.csi_records import log_of, needs_data, parsed, record
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
    oracle = csiread.Intel(str(log.path), nrxnum=log.csi.shape[2], ntxnum=log.csi.shape[3], if_report=False)
    oracle.read()
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


def test_broken_records_are_counted_and_passed_over(tmp_path: Path) -> None:
    good = encode_body(record())
    path = tmp_path / "a.dat"
    parts = [encode_file_record(CSI_CODE, body) for body in (good, good[:-1], good)]
    path.write_bytes(parts[0] + parts[1] + b"\x00\x00" + parts[2])
    log = read_dat(path)
    assert (len(log), log.malformed_count, log.skipped_bytes) == (2, 2, 0)


LOG = [encode_file_record(CSI_CODE, encode_body(record(layout=38, seed=n, frame_count=n))) for n in range(40)]
SIZE = len(LOG[0])


def read_bytes(tmp_path: Path, content: bytes) -> CsiLog:
    path = tmp_path / "a.dat"
    path.write_bytes(content)
    return read_dat(path)


def missing(log: CsiLog) -> list[int]:
    return sorted(set(range(40)) - set(log.frame_count.tolist()))


@pytest.mark.parametrize("bit", range(16))
@pytest.mark.parametrize("at", [0, 20, 39])
def test_a_damaged_length_costs_one_record(tmp_path: Path, at: int, bit: int) -> None:
    content = bytearray(b"".join(LOG))
    content[at * SIZE + bit // 8] ^= 1 << bit % 8
    log = read_bytes(tmp_path, bytes(content) + LOG[0][:70])
    assert missing(log) == [at]
    # Behind the last record there is nothing to resume at.
    skipped = SIZE if at < 39 else SIZE + 70
    assert (log.malformed_count, log.skipped_bytes, log.truncated_bytes) == (1, skipped, SIZE + 70 - skipped)


@pytest.mark.parametrize("at", [2, 2 + 1 + 8, 2 + 1 + 9, 2 + 1 + 16])
def test_damage_behind_the_length_costs_one_record_and_no_search(tmp_path: Path, at: int) -> None:
    content = bytearray(b"".join(LOG))
    content[20 * SIZE + at] ^= 0x0D
    log = read_bytes(tmp_path, bytes(content))
    assert missing(log) == [20]
    assert (log.malformed_count + log.unknown_count, log.skipped_bytes) == (1, 0)


@pytest.mark.parametrize("extra", [b"\x00", b"\x07", b"\xbb", b"\xff\xff\xff", b"\x00\x05\xc1", b"text\n" * 40])
def test_bytes_that_do_not_belong_there_cost_no_record(tmp_path: Path, extra: bytes) -> None:
    for at in (0, 17, 40):
        log = read_bytes(tmp_path, b"".join([*LOG[:at], extra, *LOG[at:]]))
        assert missing(log) == []
        # At the end they may be the beginning of a record.
        assert log.skipped_bytes + log.truncated_bytes == len(extra)
        assert log.malformed_count == 1 or at == 40


def test_bytes_that_are_missing_cost_one_record(tmp_path: Path) -> None:
    content = b"".join(LOG)
    for at in (1, 5, 50, SIZE - 1, SIZE):
        log = read_bytes(tmp_path, content[: 9 * SIZE + at] + content[9 * SIZE + at + 1 :])
        assert missing(log) == [9 + at // SIZE]
        assert (log.malformed_count, log.skipped_bytes) == (1, SIZE - 1)


def test_damage_in_a_log_with_frames_of_both_kinds(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    pairs = [encode_file_record(MPDU_CODE, rng.bytes(60 + n)) + part for n, part in enumerate(LOG)]
    clean = read_bytes(tmp_path, b"".join(pairs))
    assert (len(clean), clean.mpdu_count, clean.malformed_count) == (40, 40, 0)
    for high in (0x01, 0x40):
        spoilt = bytes([high]) + pairs[11][1:]
        log = read_bytes(tmp_path, b"".join([*pairs[:11], spoilt, *pairs[12:]]))
        assert (missing(log), log.mpdu_count, log.malformed_count) == ([], 39, 1)
        log = read_bytes(tmp_path, b"".join([*pairs[:11], bytes([high]) + pairs[11][1:], *pairs[11:]]))
        assert missing(log) == []


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "No such file"),
        (b"", "empty file"),
        (b"time,x,y,z\n" * 500, "not a CSI log"),
        (bytes(4096), "not a CSI log"),
        (b"\x7fELF" * 3000, "not a CSI log"),
        (log_of([record()])[:60], "not a CSI log"),
    ],
)
def test_files_that_are_no_log_are_named(tmp_path: Path, content: bytes | None, reason: str) -> None:
    path = tmp_path / "csi_rx_1.dat"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DatFileError, match=rf"csi_rx_1\.dat: {reason}"):
        read_dat(path)


def test_a_directory_is_no_log(tmp_path: Path) -> None:
    with pytest.raises(DatFileError, match="directory"):
        read_dat(tmp_path)
