"""What recording a flight costs: every stream at its full rate, in the share of one core, and what a replay gains."""

from __future__ import annotations

import os
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.clock import MonotonicClock
from companion.config_file import load_config
from companion.event_clock import EventClock
from companion.events import Tick
from companion.log_reader import open_session
from companion.messages import FlightMode, Pose, Setpoint, VehicleState, pose_bytes
from companion.recorder import McapRecorder, Recorder
from companion.replay.player import Player
from companion.replay.result import replay_log
from companion.streams import CSI, NEIGHBOUR, POSE, POSE_IN, PROFILE, SETPOINT, TICK, VEHICLE, Stream

_ROOT = Path(__file__).resolve().parents[1]
_STEP_S = 0.005


@dataclass(frozen=True, slots=True)
class RecorderCost:
    """`core_share` of one core over `seconds`, without the loop that feeds it; nothing may be dropped."""

    seconds: float
    core_share: float
    messages_per_s: float
    kilobytes_per_s: float
    dropped: int
    longest_record_us: float


def recorder_cost(seconds: float = 20.0) -> RecorderCost:
    """Against the same loop without a recorder."""
    config = load_config(_ROOT / "configs" / "uav.yaml")
    clock = EventClock(MonotonicClock())
    idle_s, _ = _drive(None, clock, seconds / 4)
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        path = Path(name) / "log.mcap"
        recorder = McapRecorder(path, config, clock)
        busy_s, longest_us = _drive(recorder, clock, seconds)
        recorder.close()
        counters = recorder.counters()
        size = path.stat().st_size
    share = busy_s / seconds - idle_s / (seconds / 4)
    rate = counters["written"] / seconds
    return RecorderCost(seconds, share, rate, size / seconds / 1e3, counters["dropped"], longest_us)


def replay_factor(log: Path) -> float:
    """How many seconds of flight a replay of `log` does in one second, its worker's start included."""
    session = open_session(log)
    begun = time.perf_counter()
    with Player(session, session.config(), exact=True) as player:
        result = replay_log(player, session, None)
    return result.flight_s / (time.perf_counter() - begun)


def _drive(recorder: Recorder | None, clock: EventClock, seconds: float) -> tuple[float, float]:
    """(processor time [s], longest call [us]) of a loop of 200 Hz that records what is due."""
    due = _messages()
    left = [0.0] * len(due)
    begin_cpu, begin = time.process_time(), time.monotonic()
    longest_s = 0.0
    for step in range(round(seconds / _STEP_S)):
        time.sleep(max(0.0, begin + step * _STEP_S - time.monotonic()))
        for index, (stream, rate_hz, message) in enumerate(due):
            left[index] += rate_hz * _STEP_S
            if left[index] >= 1.0 and recorder is not None:
                left[index] -= 1.0
                before = time.perf_counter()
                recorder.record(stream, clock.now_ns(), message)
                longest_s = max(longest_s, time.perf_counter() - before)
    return time.process_time() - begin_cpu, 1e6 * longest_s


def _messages() -> tuple[tuple[Stream, float, object], ...]:
    pose = Pose(1, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.1, 0.1, 0.1), 3)
    vehicle = VehicleState(
        1, 1, FlightMode.OFFBOARD, 1, True, True, False, 1, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 0.5, 0.9
    )
    power = np.random.default_rng(1).random((180, 360)).astype(np.float16).tobytes()
    return (
        (CSI, 150.0, b"\xbb" + os.urandom(230)),
        (POSE_IN, 200.0, pose_bytes(pose)),
        (POSE, 50.0, pose),
        (NEIGHBOUR, 10.0, os.urandom(400)),
        (TICK, 20.0, Tick(1)),
        (VEHICLE, 20.0, vehicle),
        (SETPOINT, 20.0, Setpoint(1, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 0.5)),
        (PROFILE, 0.3, power),
    )
