"""`companion log`: what a log holds, what is saved of a cut one, what other tools get, what is joined by time."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from companion.cli import main
from companion.core.streams import CSI, POSE_IN, VEHICLE
from companion.errors import CompanionError
from companion.log.merge import merge
from companion.log.reader import LogScan, open_session
from companion.log.repair import copy
from companion.log.ulog import Ulog
from companion.log.writer import LogWriter
from csi_bridge.dat import read_dat
from tests.golden.golden_logs import GOLDEN
from tests.ulog_file import ulog_of

FLIGHT = GOLDEN[0]
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def cli(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    def run(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["companion", *map(str, arguments)])
        monkeypatch.chdir(tmp_path)
        code: Any = 0
        try:
            main()
        except SystemExit as exit_:
            code = exit_.code or 0
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


def test_info_tells_what_a_log_holds_and_that_one_is_cut(cli: Run, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(FLIGHT.read_bytes()[:400_000])
    code, out, _ = cli("log", "info", FLIGHT, cut, "--json", tmp_path / "info.json")
    assert code == 0
    assert "whole" in out
    assert "CUT OFF" in out
    whole, half = json.loads((tmp_path / "info.json").read_text())
    counts = {topic["topic"]: topic["messages"] for topic in whole["topics"]}
    assert counts["/csi"] == sum(1 for _ in open_session(FLIGHT).messages({CSI.topic}))
    assert 0 < sum(topic["messages"] for topic in half["topics"]) < sum(counts.values())
    assert (whole["is_whole"], half["is_whole"]) == (True, False)


def test_repair_makes_a_cut_log_whole_and_replayable(cli: Run, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(FLIGHT.read_bytes()[:700_000])
    assert cli("log", "repair", cut)[0] == 0
    saved = tmp_path / "cut.repaired.mcap"
    scan = LogScan(saved)
    messages = [message.data for message in scan]
    assert scan.is_whole
    assert messages == [message.data for message in LogScan(cut)]
    assert open_session(saved).config() == open_session(FLIGHT).config()
    code, _, err = cli("log", "repair", cut)
    assert code == 1
    assert "is there already" in err


def test_a_cut_log_replays_as_far_as_it_goes(cli: Run, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(FLIGHT.read_bytes()[:800_000])
    code, out, err = cli("replay", cut, "--check")
    assert code == 0, out + err
    assert "identical" in out


@pytest.mark.parametrize("zeroed", [1, 4096])
def test_damage_costs_what_it_touched_and_a_replay_ends_before_it(cli: Run, tmp_path: Path, zeroed: int) -> None:
    content = bytearray(FLIGHT.read_bytes())
    middle = len(content) // 2
    content[middle : middle + zeroed] = bytes(byte ^ 0x55 for byte in content[middle : middle + zeroed])
    hurt = tmp_path / "hurt.mcap"
    hurt.write_bytes(content)
    messages, all_messages = list(LogScan(hurt)), list(LogScan(FLIGHT))
    assert 0.7 * len(all_messages) < len(messages) < len(all_messages)
    assert messages[-1] == all_messages[-1]
    code, out, err = cli("log", "info", hurt)
    assert code == 0, err
    assert "DAMAGED at 1 places" in out
    code, out, err = cli("log", "repair", hurt)
    assert code == 0, err
    assert f"{len(messages)} messages" in out
    assert "will differ" in err
    code, out, err = cli("replay", hurt, "--check")
    assert code == 0, out + err
    assert "cut off or damaged" in out
    # Behind the damage other inputs were heard: what differs is told in a line, not in all its numbers.
    code, out, _ = cli("replay", tmp_path / "hurt.repaired.mcap", "--check", "--json", tmp_path / "check.json")
    assert code == 1
    told = [one["difference"] for one in json.loads((tmp_path / "check.json").read_text())["check"]]
    assert any(told)
    assert all(len(one["what"]) < 500 for one in told if one is not None)


@pytest.mark.parametrize("removed", [0, 50])
def test_a_damaged_first_chunk_costs_no_channel_of_the_others(tmp_path: Path, removed: int) -> None:
    """Channels are told once, in the first chunk, and again at the end, wherever that has moved to."""
    content = bytearray(FLIGHT.read_bytes())
    at = content.index(b"\x04\0\0\0zstd") + 200  # not the word in the configuration
    content[at] ^= 0x55
    del content[at + 1 : at + 1 + removed]
    hurt = tmp_path / "hurt.mcap"
    hurt.write_bytes(content)
    assert {message.topic for message in LogScan(hurt)} >= {"/csi", "/pose/in", "/tick", "/vehicle", "/setpoint"}


@pytest.mark.parametrize("removed", [0, 50])
def test_a_damaged_first_chunk_of_a_log_that_was_cut_costs_that_chunk(tmp_path: Path, removed: int) -> None:
    """Without an index: channels are told once more behind the second chunk."""
    log = tmp_path / "log.mcap"
    with log.open("wb") as file:
        writer = LogWriter(file, dict(open_session(FLIGHT).metadata))
        first_chunk = 0
        for message in LogScan(FLIGHT):
            copy(writer, message)
            first_chunk += writer.chunks == 0
    content = bytearray(log.read_bytes()[:400_000])
    log.write_bytes(content)
    unhurt = list(LogScan(log))
    at = content.index(b"\x04\0\0\0zstd") + 200  # not the word in the configuration
    content[at] ^= 0x55
    del content[at + 1 : at + 1 + removed]
    log.write_bytes(content)
    assert list(LogScan(log)) == unhurt[first_chunk + 1 :]
    assert len(unhurt) > 3 * first_chunk


def test_export_of_a_merged_log_keeps_the_robots_apart(cli: Run, tmp_path: Path) -> None:
    session = open_session(FLIGHT)
    beacon = tmp_path / "beacon.mcap"
    with beacon.open("wb") as file:
        writer = LogWriter(file, {"role": "beacon", "name": "ground", "config": "{}"})
        for message in session.messages({CSI.topic}):
            writer.write(CSI, message.log_time_ns, message.log_time_ns, message.sequence, message.data)
        writer.finish()
    assert cli("log", "merge", FLIGHT, beacon, "--out", tmp_path / "merged.mcap")[0] == 0
    assert cli("log", "export", tmp_path / "merged.mcap", "--to", "dat", "--out", tmp_path / "x")[0] == 0
    assert (tmp_path / "x" / "ground_csi.dat").read_bytes() == (tmp_path / "x" / "csi.dat").read_bytes()


def test_export_gives_other_tools_what_they_read(cli: Run, tmp_path: Path) -> None:
    code, _, err = cli("log", "export", FLIGHT, "--out", tmp_path / "x")
    assert code == 0, err
    session = open_session(FLIGHT)
    tum = np.loadtxt(tmp_path / "x" / "pose.tum")
    assert tum.shape == (sum(1 for _ in session.messages({POSE_IN.topic})), 8)
    np.testing.assert_allclose(np.linalg.norm(tum[:, 4:], axis=1), 1.0, atol=1e-6)
    log = read_dat(tmp_path / "x" / "csi.dat")
    assert len(log) == sum(1 for _ in session.messages({CSI.topic}))
    with (tmp_path / "x" / "bearing.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    assert abs(float(rows[0]["estimate.azimuth_rad"])) < np.pi
    arrays = np.load(tmp_path / "x" / "log.npz")
    packets = int(rows[0]["estimate.packets"])
    assert arrays["aperture_0_chi_m"].shape == (packets, 3)
    assert arrays["aperture_0_channel"].dtype == complex
    assert arrays["pose"].shape == (len(tum), 10)


def test_merge_pairs_a_beacon_by_exchanges_and_px4_by_positions(cli: Run, tmp_path: Path) -> None:
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
    boot_ns = _write_ulog(ulg, session)
    out = tmp_path / "merged.mcap"
    code, text, err = cli("log", "merge", FLIGHT, beacon, "--ulg", ulg, "--out", out)
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
    assert cli("log", "merge", FLIGHT, beacon, "--out", out)[0] == 1


def test_a_ulg_that_is_damaged_or_cut_gives_what_can_be_read_or_is_refused(cli: Run, tmp_path: Path) -> None:
    ulg = tmp_path / "flight.ulg"
    _write_ulog(ulg, open_session(FLIGHT))
    content = bytearray(ulg.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 300] = bytes(300)
    ulg.write_bytes(content[: len(content) - 1_001])
    code, text, err = cli("log", "merge", FLIGHT, "--ulg", ulg, "--out", tmp_path / "out.mcap")
    assert code == 0, err
    assert "damaged, what could be read" in text
    assert "corruption" not in text  # the parser's own print
    ulg.write_bytes(content[:16] + 10 * b"\1\0F " + b"\x05\0\0")  # the parser alone never ends
    code, _, err = cli("log", "merge", FLIGHT, "--ulg", ulg, "--out", tmp_path / "none.mcap")
    assert code == 1
    assert "not a readable .ulg file: damaged" in err


def test_single_damaged_rows_of_a_ulg_move_nothing_and_are_left_out(cli: Run, tmp_path: Path) -> None:
    ulg = tmp_path / "flight.ulg"
    _write_ulog(ulg, open_session(FLIGHT))
    row_s, row_m = Ulog(ulg).positions()
    rows = [(round(1e6 * t), (n, e, -u)) for t, (e, n, u) in zip(row_s.tolist(), row_m.tolist(), strict=True)]
    rows[40] = rows[40][0], (1e38, -1e4, 3.0)
    ulg.write_bytes(
        ulog_of([*rows, (rows[-1][0] + 5_000_000_000, (0, 0, 0)), (1 << 50, (0, 0, 0)), (1 << 63, (0, 0, 0))])
    )
    out = tmp_path / "out.mcap"
    code, text, err = cli("log", "merge", FLIGHT, "--ulg", ulg, "--out", out)
    assert code == 0, err
    assert "positions agree to 0.0" in text
    flight, px4 = (list(open_session(path).messages()) for path in (FLIGHT, out))
    assert px4[-1].log_time_ns <= flight[-1].log_time_ns + 1_000_000_000


@pytest.mark.parametrize(
    ("scale", "part", "why"),
    [
        (0.0, slice(None), "not of this flight"),
        (1.0, slice(0, 40), "the vehicle moved 1.0 m where both logs could agree"),
        (1.0, slice(0, 3), "it holds positions of 0.1 s, 1 are needed"),
    ],
)
def test_a_ulg_that_could_be_of_any_time_is_refused(
    cli: Run, tmp_path: Path, scale: float, part: slice, why: str
) -> None:
    ulg = tmp_path / "still.ulg"
    _write_ulog(ulg, open_session(FLIGHT), scale=scale, part=part)
    code, _, err = cli("log", "merge", FLIGHT, "--ulg", ulg, "--out", tmp_path / "out.mcap")
    assert code == 1
    assert why in err
    assert not (tmp_path / "out.mcap").exists()


def test_merge_refuses_the_log_of_another_flight_and_says_what_it_needs(cli: Run, tmp_path: Path) -> None:
    other = tmp_path / "other.ulg"
    _write_ulog(other, open_session(FLIGHT), scale=5.0)
    with pytest.raises(CompanionError, match="not of this flight"):
        merge(FLIGHT, (), other, tmp_path / "out.mcap")
    with pytest.raises(CompanionError, match="of the same recording"):
        merge(FLIGHT, (FLIGHT,), None, tmp_path / "out.mcap")
    (tmp_path / "no.ulg").write_bytes(b"nothing")
    with pytest.raises(CompanionError, match=r"not a readable \.ulg"):
        merge(FLIGHT, (), tmp_path / "no.ulg", tmp_path / "out.mcap")
    code, _, err = cli("log", "merge", FLIGHT, "--out", tmp_path / "out.mcap")
    assert code == 2
    assert "needs no merging" in err


def test_what_cannot_be_replayed_says_why(cli: Run, tmp_path: Path) -> None:
    beacon = tmp_path / "beacon.mcap"
    metadata = dict(open_session(FLIGHT).metadata)
    config = json.loads(metadata["config"]) | {"role": "beacon"}
    with beacon.open("wb") as file:
        LogWriter(file, metadata | {"config": json.dumps(config)}).finish()
    code, _, err = cli("replay", beacon)
    assert code == 1
    assert "holds no decisions" in err
    code, _, err = cli("replay", FLIGHT, "--config", _config_file(tmp_path, config))
    assert code == 2
    assert "expected uav" in err
    with (tmp_path / "truth.mcap").open("wb") as file:
        LogWriter(file, {"role": "truth", "wall_minus_mono_ns": "0"}).finish()
    for command in ("replay", "report"):
        code, _, err = cli(command, tmp_path / "truth.mcap")
        assert code == 1
        assert "holds no configuration" in err
    (tmp_path / "cut.mcap").write_bytes(FLIGHT.read_bytes()[:100])
    code, _, err = cli("report", tmp_path / "cut.mcap")
    assert code == 1
    assert "cut off or damaged: its metadata" in err
    code, _, err = cli("replay", FLIGHT, "--speed", "-2")
    assert code == 2
    assert "positive factor" in err
    code, _, err = cli("replay", tmp_path / "none.mcap")
    assert code == 1
    assert len(err.strip().splitlines()) == 1


def test_another_configuration_is_set_beside_the_flown_one(cli: Run, tmp_path: Path) -> None:
    config = json.loads(open_session(FLIGHT).metadata["config"])
    config["aperture"]["estimator"] = "bartlett"
    other = tmp_path / "other.yaml"
    other.write_text(json.dumps(config))
    code, text, err = cli("replay", FLIGHT, "--config", other, "--out", tmp_path / "o", "--json", tmp_path / "c.json")
    assert code == 0, err
    rows = json.loads((tmp_path / "c.json").read_text())["comparison"]
    assert len(rows) >= 3
    moved = [row["moved_deg"] for row in rows if row["moved_deg"] is not None]
    assert moved and max(moved) <= 180
    assert any(deg > 0.01 for deg in moved)
    assert "open loop" in text
    assert (tmp_path / "o" / "comparison.png").read_bytes().startswith(b"\x89PNG")
    assert open_session(tmp_path / "o" / "replay.mcap").metadata["role"] == "replay"


def _config_file(folder: Path, config: dict[str, Any]) -> Path:
    path = folder / "config.yaml"
    path.write_text(json.dumps(config))
    return path


def _write_ulog(path: Path, session: Any, scale: float = 1.0, part: slice = slice(None)) -> int:
    """The vehicle's positions as PX4 logs them, NED, on a clock of its own; wall time of its boot."""
    rows = []
    for message in session.messages({VEHICLE.topic}):
        state = msgspec.json.decode(message.data)
        if state["p_local_enu_m"] is not None:
            rows.append((state["position_mono_ns"] + session.wall_minus_mono_ns, state["p_local_enu_m"]))
    boot_ns = rows[0][0] - 5_000_000_000
    ned = [((t_ns - boot_ns) // 1000, (north * scale, east * scale, -up * scale)) for t_ns, (east, north, up) in rows]
    path.write_bytes(ulog_of(ned[part]))
    return int(boot_ns)
