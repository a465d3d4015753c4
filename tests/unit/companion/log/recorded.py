"""Logs as the recorder writes them, with messages that a test can tell apart."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from companion.config.file import load_config
from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.messages import Pose, Setpoint
from companion.core.streams import CSI, SETPOINT
from companion.log.recorder import McapRecorder
from tests.manual_clock import ManualClock
from tests.paths import CONFIGS

CONFIG = load_config(CONFIGS / "uav.yaml")
POSE_AT = Pose(
    t_mono_ns=5,
    p_enu_m=(1.0, -2.0, 0.5),
    q_enu_from_body=(0.5, 0.5, -0.5, 0.5),
    v_enu_m_s=(0.1, 0.2, 0.3),
    confidence=3,
)


def setpoint(t_ns: int) -> Setpoint:
    return Setpoint(t_ns, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), 0.5)


def settings(**changes: object) -> Config:
    return dataclasses.replace(CONFIG, recorder=dataclasses.replace(CONFIG.recorder, **changes))  # type: ignore[arg-type]


def clock() -> EventClock:
    return EventClock(ManualClock(1_000))


def write(path: Path, messages: int, config: Config = CONFIG) -> McapRecorder:
    own = clock()
    recorder = McapRecorder(path, config, own)
    for number in range(messages):
        with own.event(number):
            recorder.record(SETPOINT, number, setpoint(number))
            recorder.record(CSI, number, b"\xbb" + number.to_bytes(4, "little"))
    recorder.close()
    return recorder
