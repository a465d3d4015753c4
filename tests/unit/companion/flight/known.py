"""What is known of a target in a flight that has been engaged and takes off."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from companion.config.file import load_config
from companion.config.schema import ApertureConfig
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.inputs import Event
from companion.flight.course import Course
from companion.flight.knowledge import Knowledge
from companion.flight.local_frame import LocalFrame
from companion.neighbours.neighbour import Neighbour
from companion.radio.card import ChannelSample
from companion.sensing.records import Iteration
from tests.kept import Kept
from tests.manual_clock import ManualClock
from tests.paths import CONFIGS
from wsr.aoa import AoaEstimate

TARGET, OTHER = 2, 3
NOW_NS = 100 * NS_PER_S
CONFIG = replace(
    load_config(CONFIGS / "uav.yaml"),
    aperture=ApertureConfig(min_reliability=0.5, blind_legs=3, silent_s=2.0),
)


class _Sar:
    is_ready = True
    is_measuring = True
    waited_s = 0.0

    def waiting_s(self) -> float:
        return self.waited_s


class Known:
    """The knowledge of a flight that has been engaged and takes off."""

    def __init__(self) -> None:
        self.clock, self.kept, self.sar = ManualClock(NOW_NS), Kept(), _Sar()
        clock = EventClock(self.clock)
        self.course = Course(clock, self.kept)
        neighbours = {peer: Neighbour(peer, str(peer)) for peer in (TARGET, OTHER)}
        self.knowledge = Knowledge(
            config=CONFIG,
            clock=clock,
            recorder=self.kept,
            neighbours=neighbours,
            sar=self.sar,  # type: ignore[arg-type]
            course=self.course,
            frame=LocalFrame(),
        )
        neighbours[TARGET].heard_ns = NOW_NS
        for event in (Event.ENGAGE, Event.PREFLIGHT_PASSED, Event.AIRBORNE, Event.OFFBOARD_CONFIRMED):
            self.course.step(event, NOW_NS)
        self.kept.messages.clear()

    def hear(self, peer: int) -> None:
        csi = np.zeros((30, 3), np.complex64)
        self.knowledge.heard(
            ChannelSample(peer=peer, frame=1, t_mono_ns=self.clock.now_ns(), nic_us=0, channel=csi, power_dbm=-50.0)
        )


def iteration(peer: int = TARGET, reliability: float | None = 0.9, **changes: Any) -> Iteration:
    """One without an estimate where there is no reliability."""
    infinite = ((1e-3, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0, math.inf))
    origin = (0.0, 0.0, 0.0)
    estimate = (
        None
        if reliability is None
        else AoaEstimate(
            azimuth_rad=0.5,
            polar_rad=math.pi / 2,
            azimuth_std_rad=0.03,
            polar_std_rad=math.inf,
            covariance=infinite,
            crb_rad=0.02,
            coherence=0.9,
            reliability=reliability,
            azimuth_observable=True,
            polar_observable=False,
            alternatives=(),
            packets=100,
            length_m=1.2,
            extents_m=origin,
            reference_p_m=origin,
            reference_t_s=0.0,
        )
    )
    values: dict[str, Any] = {
        "number": 1, "peer": peer, "start_ns": 0, "end_ns": 1, "fresh": 1.0, "power_dbm": -60.0,
        "reference_ns": 1, "p_local_enu_m": origin,
        "peer_p_enu_m": origin, "peer_boot": 1, "received": 100, "dropped": {}, "compute_s": 0.1,
        "estimate": estimate, "refusal": "" if estimate else "too few packets",
    }  # fmt: skip
    return Iteration(**values | changes)
