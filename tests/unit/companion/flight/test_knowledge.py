"""What is known of the target, and when it is old."""

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
from tests.manual_clock import ManualClock
from tests.paths import CONFIGS
from tests.unit.companion.flight.kept import Kept
from wsr.aoa import AoaEstimate

_TARGET, _OTHER = 2, 3
_NOW_NS = 100 * NS_PER_S
_CONFIG = replace(
    load_config(CONFIGS / "uav.yaml"),
    aperture=ApertureConfig(min_reliability=0.5, blind_legs=3, silent_s=2.0),
)


class _Sar:
    is_ready = True
    is_measuring = True
    waited_s = 0.0

    def waiting_s(self) -> float:
        return self.waited_s


class _Known:
    """The knowledge of a flight that has been engaged and takes off."""

    def __init__(self) -> None:
        self.clock, self.kept, self.sar = ManualClock(_NOW_NS), Kept(), _Sar()
        clock = EventClock(self.clock)
        self.course = Course(clock, self.kept)
        neighbours = {peer: Neighbour(peer, str(peer)) for peer in (_TARGET, _OTHER)}
        self.knowledge = Knowledge(
            config=_CONFIG,
            clock=clock,
            recorder=self.kept,
            neighbours=neighbours,
            sar=self.sar,  # type: ignore[arg-type]
            course=self.course,
            frame=LocalFrame(),
        )
        neighbours[_TARGET].heard_ns = _NOW_NS
        for event in (Event.ENGAGE, Event.PREFLIGHT_PASSED, Event.AIRBORNE, Event.OFFBOARD_CONFIRMED):
            self.course.step(event, _NOW_NS)
        self.kept.messages.clear()

    def hear(self, peer: int) -> None:
        csi = np.zeros((30, 3), np.complex64)
        self.knowledge.heard(
            ChannelSample(peer=peer, frame=1, t_mono_ns=self.clock.now_ns(), nic_us=0, channel=csi, power_dbm=-50.0)
        )


def _iteration(peer: int = _TARGET, reliability: float | None = 0.9, **changes: Any) -> Iteration:
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


def test_a_bearing_that_may_steer_is_reported_and_the_target_recorded() -> None:
    known = _Known()
    known.hear(_TARGET)
    known.knowledge.add_iteration(_iteration())
    assert known.course.worst([]) is Event.BEARING
    assert known.kept.topics == ["/target"]
    assert known.knowledge.blind_legs == 0
    assert not known.knowledge.is_stale()


def test_legs_without_one_are_counted_whatever_the_reason() -> None:
    known = _Known()
    for iteration in (
        _iteration(reliability=None, start_ns=0, end_ns=10),
        _iteration(reliability=None, start_ns=5, end_ns=15),
        _iteration(reliability=0.1, start_ns=15, end_ns=25),
        _iteration(p_local_enu_m=None, start_ns=25, end_ns=35),
    ):
        known.knowledge.add_iteration(iteration)
    known.knowledge.note_blind_leg()
    assert known.knowledge.blind_legs == 4.5
    assert known.kept.topics == ["/target"]  # the weak one is recorded, and what it says little counts
    assert known.course.worst([]) is None
    known.knowledge.grant_leg()
    assert known.knowledge.blind_legs == 1
    known.knowledge.begin_anew()
    assert known.knowledge.blind_legs == 0


def test_a_bearing_of_another_robot_is_kept_and_steers_nothing() -> None:
    known = _Known()
    known.hear(_OTHER)
    known.knowledge.add_iteration(_iteration(_OTHER))
    assert known.kept.topics == ["/target"]
    assert known.course.worst([]) is None
    assert known.knowledge.targets.target is None
    assert (known.knowledge.packets, known.knowledge.packet_age_s()) == (0, math.inf)


def test_it_is_stale_when_the_target_is_silent_or_the_worker_hangs() -> None:
    known = _Known()
    known.hear(_TARGET)
    known.knowledge.add_iteration(_iteration())
    known.sar.waited_s = 1.6
    assert known.knowledge.is_stale()
    known.sar.waited_s = 0.0
    known.clock.advance(1.9)
    assert not known.knowledge.is_stale()
    known.clock.advance(0.2)
    assert known.knowledge.is_stale()
    known.hear(_TARGET)
    assert known.knowledge.is_stale(), "its datagrams are still missing"


def test_a_bearing_of_a_flight_that_was_broken_off_lifts_no_hold() -> None:
    known = _Known()
    known.hear(_TARGET)
    known.sar.is_measuring = False
    known.knowledge.note_hold()
    known.knowledge.add_iteration(_iteration())
    assert known.course.worst([]) is None and known.knowledge.tries == 1


def test_another_target_is_heard_by_its_own_packets_and_owes_nothing_to_the_one_before() -> None:
    known = _Known()
    known.hear(_TARGET)
    known.knowledge.add_iteration(_iteration(reliability=None))
    known.knowledge.add_iteration(_iteration(_OTHER))
    known.knowledge.note_hold()
    known.clock.advance(1.0)
    known.hear(_OTHER)
    assert known.knowledge.packet_age_s(_OTHER) == 0.0 and known.knowledge.packet_age_s() == 1.0
    assert math.isinf(known.knowledge.datagram_age_s(_OTHER))
    known.knowledge.select(_OTHER)
    assert known.knowledge.neighbour.id == _OTHER and known.knowledge.named("3").id == _OTHER
    assert (known.knowledge.blind_legs, known.knowledge.tries, known.knowledge.packets) == (0.0, 0, 0)
    assert known.knowledge.packet_age_s() == 0.0 and math.isinf(known.knowledge.age_s())
    assert known.knowledge.iteration is not None and known.knowledge.iteration.peer == _OTHER
    assert known.knowledge.targets.target is not None
    known.course.worst([])
    known.knowledge.add_iteration(_iteration(_TARGET))
    assert known.course.worst([]) is None, "a bearing of the robot before steers nothing"
    known.knowledge.add_iteration(_iteration(_OTHER))
    assert known.course.worst([]) is Event.BEARING
    known.knowledge.note_blind_leg()
    known.knowledge.select(_OTHER)
    assert known.knowledge.blind_legs == 1.0, "it is the target already"
