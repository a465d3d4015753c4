"""Logs we write: byte for byte what the CSI Tool's logger wrote, and read by csiread where it is right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import csiread
import numpy as np
import pytest

from csi_bridge.dat import read_dat
from csi_bridge.dat_frames import DatFileError, frame_offsets
from csi_bridge.dat_writer import DatWriter
from csi_bridge.parser import parse_body
from csi_bridge.records import MPDU_CODE, CsiRecord
from tests.csi_records import needs_data, record
from tests.paths import DATA

REAL = (
    "csi_samples/sample_0x5_64_3000.dat",
    "csi_samples/sample_0x1_ap.dat",
    "wsr_3d/3D_1_RX_2_TX_formation_2/3D_TX_dataset_csi_rx_tx/csi_rx_2021-03-03_212019.dat",
    "wsr_dataset_dev/LOS_Set_A/0627_2D-multi-link_A_L2/csi_rx_2021-06-27_203220.dat",
)


@needs_data
@pytest.mark.parametrize("name", REAL)
def test_a_real_log_taken_apart_and_written_again_is_the_same_file(name: str, tmp_path: Path) -> None:
    data, frames = frame_offsets(DATA / name)
    with DatWriter(tmp_path / "again.dat") as writer:
        for start, end in frames:
            parsed = parse_body(data[start + 2], data[start + 3 : end])
            if isinstance(parsed, CsiRecord):
                writer.write_record(parsed)
            else:
                writer.write(data[start + 2], data[start + 3 : end])
    again = (tmp_path / "again.dat").read_bytes()
    assert again == data[: frames[-1][1]]


@pytest.mark.parametrize(("n_rx", "n_tx"), [(1, 1), (2, 1), (3, 1), (3, 2), (3, 3)])
def test_csiread_reads_what_we_write_in_layout_20(n_rx: int, n_tx: int, tmp_path: Path) -> None:
    # csiread misplaces the rows of fewer than three antennas, so that all stand in order here.
    records = [replace(record(n_rx, n_tx, 20, seed), antenna_sel=0b10_01_00) for seed in range(30)]
    with DatWriter(tmp_path / "log.dat") as writer:
        for one in records:
            writer.write(MPDU_CODE, b"frame" * 20)
            writer.write_record(one)
    oracle = csiread.Intel(str(tmp_path / "log.dat"), nrxnum=n_rx, ntxnum=n_tx, pl_size=0, if_report=False)
    oracle.read()
    assert oracle.count == 30
    log = read_dat(tmp_path / "log.dat")
    assert (len(log), log.mpdu_count, log.malformed_count, log.truncated_bytes) == (30, 30, 0, 0)
    for number, one in enumerate(records):
        assert oracle.timestamp_low[number] == one.timestamp_low_us
        assert oracle.rate[number] == one.rate
        assert oracle.agc[number] == one.agc
        np.testing.assert_array_equal(oracle.csi[number], one.csi)


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatFileError, match="nowhere"):
        DatWriter(tmp_path / "nowhere" / "log.dat")
