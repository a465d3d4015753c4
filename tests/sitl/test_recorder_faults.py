"""The recorder when it is killed, when its file is cut anywhere, when its disk is full or slow."""

from __future__ import annotations

import asyncio
import dataclasses
import errno
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.config.file import load_config, save_config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.inputs import Tick
from companion.core.streams import CSI, POSE_IN, SETPOINT, TICK
from companion.errors import CompanionError
from companion.host.control_socket import ask
from companion.host.unix_datagram import bind_datagram_socket
from companion.log.info import inspect
from companion.log.parts import open_part, parts_beside
from companion.log.reader import LogScan, open_session
from companion.log.recorder import McapRecorder
from companion.log.repair import repair
from companion.sim.operator import engage
from companion.sim.stage import Cast, set_stage
from companion.sim.truth import WorldTruth
from tests.faults import figures
from tests.faults.campaigns import runs
from tests.paths import CONFIGS
from tests.sitl.watching import listen, until

CONFIG = load_config(CONFIGS / "uav.yaml")
KILLS = runs(4, 100)


def test_fault_25_a_killed_recorder_loses_less_than_a_second(tmp_path: Path) -> None:
    chance = random.Random(25)
    lost_s = []
    for batch in range(0, KILLS, 4):
        logs = [tmp_path / f"{batch + index}.mcap" for index in range(min(4, KILLS - batch))]
        processes = [_start_recording(log) for log in logs]
        time.sleep(1.2)
        for log, process in zip(logs, processes, strict=True):
            time.sleep(chance.uniform(0.0, 0.5))
            process.send_signal(signal.SIGKILL)
            killed_ns = time.monotonic_ns()
            process.communicate()
            lost_s.append((killed_ns - _last_ns(log)) / 1e9)
    figures.record(25, kills=KILLS, worst_lost_s=round(max(lost_s), 3))
    assert max(lost_s) < 1.0


def test_fault_25_every_truncated_prefix_opens(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    part = open_part(path, {"role": "uav", "config": "{}"}, "zstd", 65536)
    for number in range(12):
        part.write(CSI, number, number, number, message=b"\xbb" + number.to_bytes(4, "little"), taken_s=0.0)
        part.write(TICK, number, number, number, message=Tick(number), taken_s=0.0)
        if number % 3 == 2:
            part.end_chunk()
    part.finish()
    whole = path.read_bytes()
    counts = []
    for size in range(len(whole) + 1):
        path.write_bytes(whole[:size])
        scan = LogScan(path)
        counts.append(len(list(scan)))
        assert scan.is_whole == (size == len(whole)), size
    assert counts == sorted(counts)
    assert (counts[0], counts[-1]) == (0, 24)
    for size in range(0, len(whole), 97):
        path.write_bytes(whole[:size])
        assert sum(topic.messages for topic in inspect(path).topics) == counts[size]
        target = tmp_path / f"{size}.mcap"
        try:
            assert repair(path, target).messages == counts[size]
        except CompanionError as error:
            assert "nothing could be saved" in str(error) and counts[size] == 0 and not target.exists()
            continue
        saved = LogScan(target)
        assert len(list(saved)) == counts[size]
        assert saved.is_whole
    figures.record(25, prefixes=len(counts))


def test_fault_26_a_slow_disk_costs_messages_that_are_counted_and_no_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(file: int) -> None:
        time.sleep(1.0)

    monkeypatch.setattr(os, "fsync", slow)
    small = dataclasses.replace(CONFIG, recorder=dataclasses.replace(CONFIG.recorder, queue_messages=100))
    recorder = McapRecorder(tmp_path / "log.mcap", small, EventClock(MonotonicClock()))
    worst_s, sent = 0.0, 0
    while recorder.counters()["dropped"] <= 100 and sent < 20_000:
        sent += 1
        begun = time.perf_counter()
        recorder.record(POSE_IN, 0, bytes(89))
        worst_s = max(worst_s, time.perf_counter() - begun)
        time.sleep(0.002)
    recorder.close()
    counters = recorder.counters()
    figures.record(26, slow_disk_dropped=counters["dropped"], slow_disk_worst_record_s=round(worst_s, 4))
    assert counters["dropped"] > 100
    assert counters["dropped"] + counters["written"] == sent
    assert sum(1 for _ in LogScan(tmp_path / "log.mcap")) == counters["written"]
    assert worst_s < 0.5  # it never waited for the disk, which took a whole second each time


def test_fault_26_a_full_disk_is_counted_and_recording_goes_on_when_there_is_room(
    small_disk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("companion.log.recorder._RETRY_S", 0.3)
    recorder = McapRecorder(small_disk / "log.mcap", CONFIG, EventClock(MonotonicClock()))
    sent = _record_for(recorder, 0.6)
    ballast = _fill(small_disk)
    sent += _record_for(recorder, 1.2)
    while_full = recorder.counters()
    assert while_full["failures"] >= 1
    assert while_full["dropped"] > 0
    ballast.unlink()
    sent += _record_for(recorder, 1.0)
    recorder.close()
    counters = recorder.counters()
    assert counters["dropped"] + counters["written"] == sent
    session = open_session(small_disk / "log.mcap")
    assert len(session.paths) >= 2
    assert sum(1 for _ in session.messages({CSI.topic})) >= counters["written"]
    figures.record(26, full_disk_dropped=counters["dropped"], full_disk_sent=sent)


async def test_fault_26_a_full_disk_never_disturbs_the_set_point_stream(small_disk: Path, tmp_path: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        stage = set_stage(Path(name), small_disk, 4, use_netlink=False)
        # Such a small disk would rightly not be engaged with; and this flight is to go on, whatever it comes near to.
        uav = dataclasses.replace(
            stage.uav,
            recorder=dataclasses.replace(stage.uav.recorder, min_free_mib=0.0),
            gate=dataclasses.replace(stage.uav.gate, min_neighbour_m=0.01),
        )
        save_config(uav, stage.directory / f"{uav.name}.yaml")
        truths: list[WorldTruth] = []
        with bind_datagram_socket(stage.truth_socket) as sock:
            async with Cast(stage, tmp_path):
                listening = asyncio.create_task(listen(sock, truths))
                await engage(stage.control_socket, 90.0)
                await until(stage.control_socket, lambda status: status["state"] == "acquiring")
                _fill(small_disk)
                begin = truths[-1].vehicle
                # Through the end of the first aperture and its answer, on which it sets out.
                await until(stage.control_socket, lambda status: status["state"] == "approaching")
                await asyncio.sleep(1.0)
                end = truths[-1].vehicle
                status = await ask(stage.control_socket, "status")
                listening.cancel()
    counters = status["health"]["recorder"]
    rate_hz = (end.setpoints - begin.setpoints) / ((end.t_mono_ns - begin.t_mono_ns) / 1e9)
    figures.record(26, flight_rate_hz=round(rate_hz, 2), flight_dropped=counters["dropped"])
    assert status["state"] == "approaching"
    assert counters["failures"] >= 1
    assert counters["dropped"] > 100
    assert rate_hz >= 18
    assert end.mode == "OFFBOARD"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 6 MB of its own."""
    place = tmp_path / "disk"
    place.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=6m", "tmpfs", str(place)]
    done = subprocess.run(mount, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"a small disk cannot be mounted here: {done.stderr.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)


def _fill(place: Path) -> Path:
    ballast = place / "ballast"
    with ballast.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError as error:
            assert error.errno == errno.ENOSPC
    return ballast


def _record_for(recorder: McapRecorder, seconds: float) -> int:
    end, count = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        recorder.record(CSI, 0, b"\xbb" + os.urandom(229))
        count += 1
        time.sleep(0.002)
    return count


def _start_recording(log: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "tests.faults.recorder_process", str(log)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"recording\n"
    return process


def _last_ns(log: Path) -> int:
    """Monotonic time of the last message."""
    session = open_session(log)
    assert parts_beside(log) == [log]
    last = max(message.log_time_ns for message in session.messages({CSI.topic, POSE_IN.topic, SETPOINT.topic}))
    return last - session.wall_minus_mono_ns
