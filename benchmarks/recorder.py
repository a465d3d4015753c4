"""What recording a flight costs: all that comes in bulk at its full rate, in the share of one core, and what a replay
gains."""

from __future__ import annotations

import os
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from companion.config.file import load_config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.inputs import Tick
from companion.core.messages import FlightMode, Pose, Setpoint, VehicleState, pose_bytes
from companion.core.recorder import Recorder
from companion.core.streams import APERTURE, CSI, NEIGHBOUR, POSE, POSE_IN, PROFILE, SETPOINT, TICK, VEHICLE, Stream
from companion.log.reader import open_session
from companion.log.recorder import McapRecorder
from companion.replay.player import Player
from companion.replay.result import replay_log
from companion.sensing.records import ApertureRecord

_ROOT = Path(__file__).resolve().parents[1]
_STEP_S = 0.005
DueMessage = tuple[Stream, float, object]


@dataclass(frozen=True, slots=True, kw_only=True)
class RecorderCost:
    """Shares of one core over `seconds`: processor time of the writer's own thread, and of the calls that hand the
    messages over, each by the clock of its thread; nothing may be dropped."""

    seconds: float
    core_share: float
    """Both together."""
    writer_share: float
    calls_share: float
    messages_per_s: float
    kilobytes_per_s: float
    dropped: int
    longest_record_us: float


def recorder_cost(seconds: float = 20.0) -> RecorderCost:
    """Records for `seconds`. The rest (bearings, health, the mission's steps) is a few messages a second."""
    config = load_config(_ROOT / "configs" / "uav.yaml")
    clock = EventClock(MonotonicClock())
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        path = Path(name) / "log.mcap"
        recorder = McapRecorder(path, config, clock)
        writer = next(thread for thread in threading.enumerate() if thread.name == "recorder")
        assert writer.ident is not None
        writer_clock = time.pthread_getcpuclockid(writer.ident)
        begun_s = time.clock_gettime(writer_clock)
        calls_s, longest_us = drive(recorder, clock, seconds, flight_messages())
        writer_s = time.clock_gettime(writer_clock) - begun_s
        recorder.close()
        counters = recorder.counters()
        size = path.stat().st_size
    writer_share, calls_share = writer_s / seconds, calls_s / seconds
    return RecorderCost(
        seconds=seconds,
        core_share=writer_share + calls_share,
        writer_share=writer_share,
        calls_share=calls_share,
        messages_per_s=counters["written"] / seconds,
        kilobytes_per_s=size / seconds / 1e3,
        dropped=counters["dropped"],
        longest_record_us=longest_us,
    )


def replay_factor(log: Path) -> float:
    """How many seconds of flight a replay of `log` does in one second, its worker's start included."""
    session = open_session(log)
    begun = time.perf_counter()
    with Player(session, session.config(), exact=True) as player:
        result = replay_log(player, session, None)
    return result.flight_s / (time.perf_counter() - begun)


def drive(recorder: Recorder, clock: EventClock, seconds: float, due: tuple[DueMessage, ...]) -> tuple[float, float]:
    """(processor time of all calls [s], longest call [us]) of a loop of 200 Hz that records what is `due`;
    a message that is a function is made by it."""
    left = [0.0] * len(due)
    begin = time.monotonic()
    calls_s = longest_s = 0.0
    for step in range(round(seconds / _STEP_S)):
        time.sleep(max(0.0, begin + step * _STEP_S - time.monotonic()))
        for index, (stream, rate_hz, message) in enumerate(due):
            left[index] += rate_hz * _STEP_S
            if left[index] >= 1.0:
                left[index] -= 1.0
                before, cpu_before = time.perf_counter(), time.thread_time()
                recorder.record(stream, clock.now_ns(), message() if callable(message) else message)
                calls_s += time.thread_time() - cpu_before
                longest_s = max(longest_s, time.perf_counter() - before)
    return calls_s, 1e6 * longest_s


def flight_messages() -> tuple[DueMessage, ...]:
    """Streams of a flight with their rates [Hz]."""
    pose = Pose(
        t_mono_ns=1,
        p_enu_m=(1.0, 2.0, 3.0),
        q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
        v_enu_m_s=(0.1, 0.1, 0.1),
        confidence=3,
    )
    vehicle = VehicleState(
        t_mono_ns=1, heartbeat_mono_ns=1, mode=FlightMode.OFFBOARD, mode_mono_ns=1, armed=True, in_air=True,
        position_mono_ns=1, p_local_enu_m=(1.0, 2.0, 3.0), v_local_enu_m_s=(0.1, 0.2, 0.3), yaw_enu_rad=0.5,
        battery_remaining=0.9,
    )  # fmt: skip
    packets = 480
    chi = np.random.default_rng(2).normal(size=(packets, 3))
    aperture = ApertureRecord(
        number=1, peer=2, start_ns=1, end_ns=2, t_s=bytes(8 * packets), chi_m=chi.tobytes(),
        channel=chi[:, :2].tobytes(), wavelength_m=0.055, reference_p_m=(1.0, 2.0, 3.0),
    )  # fmt: skip
    power = np.random.default_rng(1).random((180, 360)).astype(np.float16).tobytes()
    return (
        (CSI, 150.0, b"\xbb" + os.urandom(230)),
        (POSE_IN, 200.0, pose_bytes(pose)),
        (POSE, 50.0, pose),
        (NEIGHBOUR, 10.0, os.urandom(400)),
        (TICK, 20.0, Tick(1)),
        (VEHICLE, 20.0, vehicle),
        (SETPOINT, 20.0, Setpoint(1, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 0.5)),
        (APERTURE, 0.3, aperture),
        (PROFILE, 0.3, power),
    )
