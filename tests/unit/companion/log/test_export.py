"""`companion log export`: what other tools read."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from companion.core.streams import CSI, POSE_IN
from companion.log.reader import open_session
from companion.log.writer import LogWriter
from csi_bridge.dat import read_dat
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.records import FEITCSI_CODE
from tests.feit_records import read_log, record, same
from tests.flight_logs import deaf_log
from tests.log_commands import FLIGHT, Run


def test_export_of_a_merged_log_keeps_the_robots_apart(companion: Run, tmp_path: Path) -> None:
    session = open_session(FLIGHT)
    beacon = tmp_path / "beacon.mcap"
    with beacon.open("wb") as file:
        writer = LogWriter(file, {"role": "beacon", "name": "ground", "config": "{}"})
        for message in session.messages({CSI.topic}):
            writer.write(CSI, message.log_time_ns, message.log_time_ns, message.sequence, message=message.data)
        writer.finish()
    deaf_log(tmp_path / "deaf.mcap", session)
    assert companion("log", "merge", tmp_path / "deaf.mcap", beacon, "--out", tmp_path / "merged.mcap")[0] == 0
    assert companion("log", "export", tmp_path / "merged.mcap", "--to", "dat", "--out", tmp_path / "x")[0] == 0
    assert (tmp_path / "x" / "ground_csi.dat").read_bytes() == (tmp_path / "x" / "csi.dat").read_bytes()


def test_export_gives_other_tools_what_they_read(companion: Run, tmp_path: Path) -> None:
    code, _, err = companion("log", "export", FLIGHT, "--out", tmp_path / "x")
    assert code == 0, err
    session = open_session(FLIGHT)
    tum = np.loadtxt(tmp_path / "x" / "pose.tum")
    assert tum.shape == (sum(1 for _ in session.messages({POSE_IN.topic})), 8)
    np.testing.assert_allclose(np.linalg.norm(tum[:, 4:], axis=1), 1.0, atol=1e-6)
    log = read_dat(tmp_path / "x" / "csi.dat")
    assert len(log) == sum(1 for _ in session.messages({CSI.topic}))
    with (tmp_path / "x" / "bearing.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 12
    assert abs(float(rows[0]["estimate.azimuth_rad"])) < np.pi
    arrays = np.load(tmp_path / "x" / "log.npz")
    packets = int(rows[0]["estimate.packets"])
    assert arrays["aperture_0_chi_m"].shape == (packets, 3)
    assert arrays["aperture_0_channel"].dtype == complex
    assert arrays["pose"].shape == (len(tum), 10)


def test_what_is_left_of_a_cut_log_is_exported_and_said_to_be_cut(companion: Run, tmp_path: Path) -> None:
    (tmp_path / "cut.mcap").write_bytes(FLIGHT.read_bytes()[:-40_000])
    code, _, err = companion("log", "export", tmp_path / "cut.mcap", "--to", "tum", "--out", tmp_path / "x")
    assert code == 0 and "cut.mcap: cut off or damaged; what can be read of it is exported" in err
    assert len(np.loadtxt(tmp_path / "x" / "pose.tum")) > 100
    assert "cut off" not in companion("log", "export", FLIGHT, "--to", "tum", "--out", tmp_path / "y")[2]


def test_a_flight_with_an_ax_card_gives_a_log_of_feitcsi(companion: Run, tmp_path: Path) -> None:
    records = [record(seed=number, stamp_us=10_000 * number) for number in range(5)]
    with (tmp_path / "ax.mcap").open("wb") as file:
        writer = LogWriter(file, {"role": "uav", "name": "uav", "config": "{}"})
        for number, one in enumerate(records):
            writer.write(CSI, number, number, number, message=bytes([FEITCSI_CODE]) + encode_record(one))
        writer.finish()
    companion("log", "export", tmp_path / "ax.mcap", "--to", "dat", "--out", tmp_path / "out")
    found = read_log(tmp_path / "out" / "csi.csi")
    assert found.damaged_count == 0 and len(found.records) == len(records)
    assert all(same(a, b) for a, b in zip(found.records, records, strict=True))
