"""`companion log merge`: logs of several robots and of PX4 on one clock."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from companion.core.streams import CSI, VEHICLE
from companion.errors import CompanionError
from companion.log.merge import merge
from companion.log.reader import LogScan, open_session
from companion.log.writer import LogWriter
from tests.log_commands import FLIGHT, Run, write_ulog


def test_merge_pairs_a_beacon_by_exchanges_and_px4_by_positions(companion: Run, tmp_path: Path) -> None:
    session = open_session(FLIGHT)
    beacon = tmp_path / "beacon.mcap"
    shift_ns = 38_123_000_000  # its clock is elsewhere
    with beacon.open("wb") as file:
        writer = LogWriter(file, {"role": "beacon", "name": "ground", "config": "{}"})
        for message in session.messages({CSI.topic}):
            t_ns = message.log_time_ns - shift_ns
            writer.write(CSI, t_ns, t_ns, message.sequence, message.data)
        writer.finish()
    ulg = tmp_path / "flight.ulg"
    boot_ns = write_ulog(ulg, session)
    out = tmp_path / "merged.mcap"
    code, text, err = companion("log", "merge", FLIGHT, beacon, "--ulg", ulg, "--out", out)
    assert code == 0, err
    assert "+38.1230 s" in text
    times: dict[str, list[int]] = {}
    firsts: dict[str, bytes] = {}
    for message in LogScan(out):
        times.setdefault(message.topic, []).append(message.log_time_ns)
        firsts.setdefault(message.topic, message.data)
    assert abs(times["/ground/csi"][0] - times["/csi"][0]) < 1_000_000
    ours = {m.topic: m.log_time_ns for m in session.messages({VEHICLE.topic})}
    assert times["/px4/vehicle_local_position"][-1] <= ours["/vehicle"] + 20_000_000
    first = msgspec.json.decode(firsts["/px4/vehicle_local_position"])
    assert abs(first["timestamp"] * 1000 + boot_ns - times["/px4/vehicle_local_position"][0]) < 20_000_000
    assert first["x"] is None  # the estimator was not ready yet, and JSON has no nan
    battery = msgspec.json.decode(firsts["/px4/battery_status_1"])
    assert battery | {"timestamp": 0} == {
        "timestamp": 0, "voltage_v": pytest.approx(15.8), "remaining": None, "cell_count": 4,
    }  # fmt: skip
    assert "esc[1].esc_rpm" in msgspec.json.decode(firsts["/px4/esc_status"])
    assert not any(b"_padding" in data for data in firsts.values())
    assert open_session(out).config() == session.config()
    assert companion("log", "merge", FLIGHT, beacon, "--out", out)[0] == 1


def test_merge_refuses_the_log_of_another_flight_and_says_what_it_needs(companion: Run, tmp_path: Path) -> None:
    other = tmp_path / "other.ulg"
    write_ulog(other, open_session(FLIGHT), scale=5.0)
    with pytest.raises(CompanionError, match="not of this flight"):
        merge(FLIGHT, (), other, tmp_path / "out.mcap")
    with pytest.raises(CompanionError, match="of the same recording"):
        merge(FLIGHT, (FLIGHT,), None, tmp_path / "out.mcap")
    (tmp_path / "no.ulg").write_bytes(b"nothing")
    with pytest.raises(CompanionError, match=r"not a readable \.ulg"):
        merge(FLIGHT, (), tmp_path / "no.ulg", tmp_path / "out.mcap")
    code, _, err = companion("log", "merge", FLIGHT, "--out", tmp_path / "out.mcap")
    assert code == 2
    assert "needs no merging" in err
