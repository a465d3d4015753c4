"""`companion log merge`: logs of several robots and of PX4 on one clock, if they are of one flight.

What decides: what was broadcast, the MACs, the spread; never counters alone.
"""

from __future__ import annotations

import random
from pathlib import Path

import msgspec
import pytest

from companion.core.streams import CSI, VEHICLE
from companion.errors import CompanionError
from companion.log.merge import merge
from companion.log.reader import LogScan, open_session
from companion.log.writer import LogWriter
from tests.flight_logs import beacon_log, deaf_log, uav_log
from tests.golden.golden_logs import GOLDEN
from tests.log_commands import Run, write_ulog

GOLDEN_FLIGHT = open_session(GOLDEN[0])


@pytest.fixture(scope="module")
def uav(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("uav") / "log.mcap"
    uav_log(path, GOLDEN_FLIGHT)
    return path


@pytest.fixture(scope="module")
def deaf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("deaf") / "log.mcap"
    deaf_log(path, GOLDEN_FLIGHT)
    return path


def test_a_beacon_of_this_flight_is_joined_by_what_it_broadcast(uav: Path, tmp_path: Path) -> None:
    beacon_log(tmp_path / "beacon.mcap", GOLDEN_FLIGHT, shift_ns=38_123_000_000)
    (joined,) = merge(uav, [tmp_path / "beacon.mcap"], None, tmp_path / "out.mcap")
    assert joined.offset_s == pytest.approx(38.123, abs=1e-3)
    assert "/ground/csi" in {message.topic for message in LogScan(tmp_path / "out.mcap")}


def test_times_that_do_not_fit_are_refused_where_nothing_was_broadcast(deaf: Path, tmp_path: Path) -> None:
    chance = random.Random(1)
    beacon_log(tmp_path / "beacon.mcap", GOLDEN_FLIGHT, jitter_ns=lambda frame: chance.randrange(2_000_000_000))
    with pytest.raises(CompanionError, match=r"not of this flight: \d+ exchanges have numbers in common"):
        merge(deaf, [tmp_path / "beacon.mcap"], None, tmp_path / "out.mcap")


def test_clocks_that_drift_apart_are_no_spread(uav: Path, tmp_path: Path) -> None:
    beacon_log(tmp_path / "beacon.mcap", GOLDEN_FLIGHT, jitter_ns=lambda frame: 200_000 * frame)
    (joined,) = merge(uav, [tmp_path / "beacon.mcap"], None, tmp_path / "out.mcap")
    assert "exchanges in common" in joined.how


def test_a_clock_that_was_never_set_is_not_joined_by_wall_clock(tmp_path: Path) -> None:
    with (tmp_path / "other.mcap").open("wb") as file:
        writer = LogWriter(file, {"role": "beacon", "name": "old", "config": "{}"})
        for number in range(5):
            writer.write(CSI, number * 10**9, number * 10**9, 0, message=b"\xbb")
        writer.finish()
    with pytest.raises(CompanionError, match="its wall clock was at another time altogether"):
        merge(GOLDEN[0], [tmp_path / "other.mcap"], None, tmp_path / "out.mcap")


def test_merge_pairs_a_beacon_by_exchanges_and_px4_by_positions(companion: Run, deaf: Path, tmp_path: Path) -> None:
    session = GOLDEN_FLIGHT
    beacon = tmp_path / "beacon.mcap"
    shift_ns = 38_123_000_000  # its clock is elsewhere
    with beacon.open("wb") as file:
        writer = LogWriter(file, {"role": "beacon", "name": "ground", "config": "{}"})
        for message in session.messages({CSI.topic}):
            t_ns = message.log_time_ns - shift_ns
            writer.write(CSI, t_ns, t_ns, message.sequence, message=message.data)
        writer.finish()
    ulg = tmp_path / "flight.ulg"
    boot_ns = write_ulog(ulg, session)
    out = tmp_path / "merged.mcap"
    code, text, err = companion("log", "merge", deaf, beacon, "--ulg", ulg, "--out", out)
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
    assert companion("log", "merge", GOLDEN[0], beacon, "--out", out)[0] == 1


def test_merge_refuses_the_log_of_another_flight_and_says_what_it_needs(companion: Run, tmp_path: Path) -> None:
    other = tmp_path / "other.ulg"
    write_ulog(other, GOLDEN_FLIGHT, scale=5.0)
    with pytest.raises(CompanionError, match="not of this flight"):
        merge(GOLDEN[0], (), other, tmp_path / "out.mcap")
    with pytest.raises(CompanionError, match="of the same recording"):
        merge(GOLDEN[0], (GOLDEN[0],), None, tmp_path / "out.mcap")
    (tmp_path / "no.ulg").write_bytes(b"nothing")
    with pytest.raises(CompanionError, match=r"not a \.ulg file: another file|not a .ulg file: a text file"):
        merge(GOLDEN[0], (), tmp_path / "no.ulg", tmp_path / "out.mcap")
    code, _, err = companion("log", "merge", GOLDEN[0], "--out", tmp_path / "out.mcap")
    assert code == 2
    assert "needs no merging" in err
