"""Where records begin and end in a log, however damaged it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from csi_bridge.dat import CsiLog, read_dat
from csi_bridge.dat_frames import DatFileError
from csi_bridge.encoder import encode_body, encode_file_record
from csi_bridge.records import CSI_CODE, MPDU_CODE
from tests.csi_records import log_of, record


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
