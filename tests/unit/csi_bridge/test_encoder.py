"""Records to bytes and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from csi_bridge.dat import read_dat
from csi_bridge.dat_frames import content, offsets, sound_frames
from csi_bridge.encoder import EncodeError, encode_bodies, encode_body, encode_file_record
from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, MPDU_CODE, CsiRecord
from tests.csi_records import log_of, needs_data, read_with_csiread, record, same
from tests.paths import DATA


def test_reads_what_the_encoder_wrote() -> None:
    for layout in (20, 34, 38):
        parsed = parse_body(CSI_CODE, encode_body(record(layout=layout)))
        assert isinstance(parsed, CsiRecord)
        assert same(parsed, record(layout=layout))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"layout": 21}, "layout 21"),
        ({"n_rx": 2}, "shape"),
        ({"csi": np.full((30, 3, 1), 128, np.complex64)}, "-128..127"),
        ({"csi": np.full((30, 3, 1), 0.5, np.complex64)}, "whole"),
        ({"csi": np.full((30, 3, 1), np.nan, np.complex64)}, "whole"),
        ({"mac": b"short"}, "MAC"),
        ({"frame_count": None}, "frame_count"),
        ({"agc": 256}, "does not fit"),
        ({"frame_count": 1 << 32}, "does not fit"),
    ],
)
def test_encoder_refuses_what_no_card_reports(change: dict[str, object], reason: str) -> None:
    with pytest.raises(EncodeError, match=reason):
        encode_body(replace(record(), **change))  # type: ignore[arg-type]


def test_records_written_together_are_those_written_one_by_one() -> None:
    records = [replace(record(layout=layout), antenna_sel=sel) for layout, sel in ((20, 0b10_01_00), (38, 0b01_10_00))]
    assert encode_bodies(records) == [encode_body(one) for one in records]
    assert encode_bodies([]) == []
    fewer = replace(records[0], n_rx=2, csi=records[0].csi[:, :2])
    with pytest.raises(EncodeError, match="encode them apart"):
        encode_bodies([*records, fewer])
    whole, broken = records[0], replace(records[1], csi=records[1].csi + np.complex64(0.5))
    with pytest.raises(EncodeError, match="whole numbers"):
        encode_bodies([whole, broken])


REAL = (
    "csi_samples/sample_0x5_64_3000.dat",
    "csi_samples/sample_0x1_ap.dat",
    "wsr_3d/3D_1_RX_2_TX_formation_2/3D_TX_dataset_csi_rx_tx/csi_rx_2021-03-03_212019.dat",
    "wsr_dataset_dev/LOS_Set_A/0627_2D-multi-link_A_L2/csi_rx_2021-06-27_203220.dat",
)


@needs_data
@pytest.mark.parametrize("name", REAL)
def test_a_real_log_taken_apart_and_written_again_is_the_same_file(name: str) -> None:
    data = content(DATA / name)
    frames = offsets(sound_frames(DATA / name, data))
    again = b""
    for start, end in frames:
        code, body = data[start + 2], data[start + 3 : end]
        one = parse_body(code, body)
        again += encode_file_record(code, encode_body(one) if isinstance(one, CsiRecord) else body)
    assert again == data[: frames[-1][1]]


@pytest.mark.parametrize(("n_rx", "n_tx"), [(1, 1), (2, 1), (3, 1), (3, 2), (3, 3)])
def test_csiread_reads_what_we_write_in_layout_20(n_rx: int, n_tx: int, tmp_path: Path) -> None:
    # csiread misplaces the rows of fewer than three antennas, so that all stand in order here.
    records = [replace(record(n_rx, n_tx, 20, seed), antenna_sel=0b10_01_00) for seed in range(30)]
    mpdu = encode_file_record(MPDU_CODE, b"frame" * 20)
    (tmp_path / "log.dat").write_bytes(b"".join(mpdu + log_of([one]) for one in records))
    oracle = read_with_csiread(tmp_path / "log.dat", n_rx, n_tx)
    assert oracle.count == 30
    log = read_dat(tmp_path / "log.dat")
    assert (len(log), log.mpdu_count, log.malformed_count, log.truncated_bytes) == (30, 30, 0, 0)
    for number, one in enumerate(records):
        assert oracle.timestamp_low[number] == one.timestamp_low_us
        assert oracle.rate[number] == one.rate
        assert oracle.agc[number] == one.agc
        np.testing.assert_array_equal(oracle.csi[number], one.csi)
