"""What a log of CSI holds, told by its content."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.analysis.csi_logs import as_json, lines, read_content
from companion.errors import CompanionError
from csi_bridge.encoder import encode_file_record
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.rate import Format
from csi_bridge.records import MPDU_CODE, CsiRecord
from tests import csi_records, feit_records
from tests.csi_records import log_of


def _records(count: int, gap_at: int = -1) -> list[CsiRecord]:
    """One each 5 ms, by the card's clock and the host's; a second is missing before number `gap_at`."""
    late = [200 if 0 <= gap_at <= number else 0 for number in range(count)]
    return [
        replace(
            csi_records.record(seed=number),
            timestamp_low_us=5000 * (number + late[number]),
            host_time_ns=1_700_000_000 * 10**9 + 5_000_000 * (number + late[number]),
        )
        for number in range(count)
    ]


def _written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def test_of_a_5300_senders_antennas_rate_and_clocks(tmp_path: Path) -> None:
    content = read_content(_written(tmp_path / "a.dat", log_of(_records(101))))
    assert content.format == "Intel 5300, header of 38 bytes"
    assert (content.whole, content.damaged, content.cut_off_bytes) == (101, 0, 0)
    assert content.senders == {"00:21:6A:3F:17:5A": 101}
    assert content.antennas == {"A": 40.0 - 44.0 - 38.0, "B": 33.0 - 44.0 - 38.0}, "C reported nothing"
    assert content.rate_hz == pytest.approx(200.0)
    assert [(clock.name, clock.resets) for clock in content.clocks] == [("card", 0), ("host", 0)]
    assert content.span_s == pytest.approx(0.5)
    assert content.gaps[0] == 0
    assert content.picture.amplitude.shape == (101, 30)


def test_a_gap_and_a_clock_that_was_set_back_are_told(tmp_path: Path) -> None:
    content = read_content(_written(tmp_path / "a.dat", log_of(_records(100, gap_at=40))))
    count, longest_s = content.gaps
    assert count == 1
    assert longest_s == pytest.approx(1.005)
    assert "1 gaps, the longest 1.005 s" in "\n".join(lines(content))
    set_back = [*_records(50), *_records(50)]
    for number in range(50, 100):
        set_back[number] = replace(set_back[number], timestamp_low_us=5000 * number)
    jumped = read_content(_written(tmp_path / "b.dat", log_of(set_back)))
    assert [clock.resets for clock in jumped.clocks] == [0, 0], "a quarter of a second is no reset"
    again = [replace(one, host_time_ns=(one.host_time_ns or 0) - 10**9 * (n > 50)) for n, one in enumerate(set_back)]
    assert [clock.resets for clock in read_content(_written(tmp_path / "c.dat", log_of(again))).clocks] == [0, 1]


def test_damage_and_mixed_formats_of_an_ax_card_are_counted(tmp_path: Path) -> None:
    good = [
        encode_record(feit_records.record(*kind, seed=number, stamp_us=1000 * number))
        for number, kind in enumerate([(Format.HT, 20), (Format.HE, 80), (Format.HT, 20), (Format.HT, 20)])
    ]
    data = b"".join([*good[:2], b"junk!", *good[2:], good[0][:300]])
    told = as_json(read_content(_written(tmp_path / "log.csi", data)))
    json.dumps(told, allow_nan=False)
    assert told["records"] == {"whole": 4, "damaged": 1, "cut_off": 1, "skipped_bytes": 5, "cut_off_bytes": 300}
    assert told["kinds"] == {"HT 20 MHz": 3, "HE 80 MHz": 1}
    assert (told["widths_mhz"], told["subcarriers"]) == ([20, 80], [56, 996])
    assert told["span_s"] == pytest.approx(3e-3)
    assert told["antennas"] == {"A": -40.0, "B": -45.0}


def test_the_picture_is_of_the_usual_kind_of_record(tmp_path: Path) -> None:
    kinds = [(Format.HT, 20), (Format.HE, 80), (Format.HT, 20)]
    data = [encode_record(feit_records.record(*kind, stamp_us=1000 * n)) for n, kind in enumerate(kinds)]
    picture = read_content(_written(tmp_path / "log.csi", b"".join(data))).picture
    assert picture.amplitude.shape == (2, 56)
    assert picture.antenna == "A"
    np.testing.assert_allclose(picture.t_s, [0.0, 2e-3], atol=1e-6)


@pytest.mark.parametrize(
    ("data", "named"),
    [
        (b"", "empty file"),
        (b"t,x,y,z\n" * 50, "no CSI log that can be read: a text file"),
        (encode_file_record(MPDU_CODE, bytes(80)) * 5, "frames and no CSI in it"),
    ],
)
def test_what_is_no_log_of_csi_is_named(tmp_path: Path, data: bytes, named: str) -> None:
    with pytest.raises(CompanionError, match=rf"a\.dat: .*{named}|a\.dat: {named}"):
        read_content(_written(tmp_path / "a.dat", data))
    with pytest.raises(CompanionError, match="No such file"):
        read_content(tmp_path / "missing.dat")
