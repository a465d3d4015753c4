"""What is known of the target: its packets and datagrams, its bearings, and the path that gave none."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import asdict
from typing import Final

from companion.config.schema import Config
from companion.core.clock import age_s
from companion.core.event_clock import EventClock
from companion.core.inputs import Event
from companion.core.messages import VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import TARGET
from companion.flight.course import Course
from companion.flight.local_frame import LocalFrame
from companion.flight.records import target_report
from companion.guidance.steering import Aim
from companion.guidance.targets import Targets
from companion.neighbours.neighbour import Neighbour
from companion.radio.card import ChannelSample
from companion.safety.gate import GateLimits
from companion.sensing.iterations import SarIterations
from companion.sensing.records import Iteration

_log = logging.getLogger(__name__)
_BEARING_LATE_S: Final = 1.5
_GRANTED: Final = 2.0
"""Apertures' worth of path after a hold: the first may still lack what was missing before."""
_FOUND: Final = 0.5
"""Bearings that say little each, but agree on a source of this probability, steer too."""


class Knowledge:
    """Takes packets and iterations of all neighbours; a bearing that may steer is reported to the course."""

    def __init__(
        self,
        *,
        config: Config,
        clock: EventClock,
        recorder: Recorder,
        neighbours: Mapping[int, Neighbour],
        sar: SarIterations,
        course: Course,
        frame: LocalFrame,
    ) -> None:
        self._config = config.aperture
        self._clock = clock
        self._recorder = recorder
        self._sar = sar
        self._course = course
        self._frame = frame
        self.neighbour: Final = neighbours[config.target]
        """The target as a sender of datagrams."""
        self.targets: Final = Targets(
            neighbours=neighbours,
            target=config.target,
            arrival_range_m=config.mission.arrival_range_m,
            arrival_confidence=config.mission.arrival_confidence,
            limits=GateLimits(**asdict(config.gate)),
        )
        self._packet_ns: int | None = None
        self._packets = 0
        self._blind_legs = 0.0
        self._tries = 0
        self._iteration: Iteration | None = None

    def aim(self, vehicle: VehicleState) -> Aim | None:
        """Where to fly; None while nothing is known of the target."""
        p_m = vehicle.p_local_enu_m
        return None if p_m is None else self.targets.aim(p_m)

    def heard(self, sample: ChannelSample) -> None:
        """A packet was measured."""
        if sample.peer == self.neighbour.id:
            self._packet_ns = sample.t_mono_ns
            self._packets += 1

    def add_iteration(self, iteration: Iteration) -> None:
        """A SAR iteration has ended."""
        bearing = iteration.bearing()
        steers = False
        if bearing is not None:
            target = self.targets.add(iteration.peer, bearing, self._frame.ground_m)
            self._recorder.record(TARGET, bearing.t_mono_ns, target_report(iteration, bearing, target))
            steers = bearing.reliability >= self._config.min_reliability or target.probability >= _FOUND
        if iteration.peer == self.neighbour.id:
            self._note(iteration, steers)

    @property
    def packets(self) -> int:
        """Heard since the newest iteration."""
        return self._packets

    @property
    def iteration(self) -> Iteration | None:
        """The newest of the target that gave an estimate, whether it may steer or not."""
        return self._iteration

    @property
    def blind_legs(self) -> float:
        """Apertures' worth of path since the newest bearing that may steer."""
        return self._blind_legs

    @property
    def tries(self) -> int:
        """Times the vehicle has held since then."""
        return self._tries

    def packet_age_s(self) -> float:
        return age_s(self._packet_ns, self._clock.now_ns())

    def datagram_age_s(self) -> float:
        return age_s(self.neighbour.heard_ns, self._clock.now_ns())

    def age_s(self) -> float:
        """Since the target was last heard, by its packets and by its datagrams, whichever is older."""
        return max(self.packet_age_s(), self.datagram_age_s())

    def is_stale(self) -> bool:
        """Whether what is known of the target's direction is old: it is silent, legs gave none, or the worker hangs or
        is gone."""
        if self._iteration is None:
            return True
        late = self._sar.waiting_s() > _BEARING_LATE_S or not self._sar.is_ready
        return self.age_s() > self._config.silent_s or late or self._blind_legs >= self._config.blind_legs

    def begin_anew(self) -> None:
        """A mission begins: places of the one before count no more."""
        self.targets.forget()
        self._blind_legs, self._tries = 0.0, 0

    def note_blind_leg(self) -> None:
        """A leg was given up."""
        self._blind_legs += 1

    def note_hold(self) -> None:
        self._tries += 1

    def grant_leg(self) -> None:
        """Some more path may be flown to measure anew."""
        self._blind_legs = max(0.0, self._config.blind_legs - _GRANTED)

    def _note(self, iteration: Iteration, steers: bool) -> None:
        self._packets = 0
        self._blind_legs += iteration.fresh
        if iteration.estimate is None:
            _log.warning("SAR iteration %d refused: %s", iteration.number, iteration.refusal)
            return
        self._iteration = iteration
        if steers and self._sar.is_measuring:  # not of a flight that was broken off since
            self._blind_legs, self._tries = 0.0, 0
            self._course.report(Event.BEARING)
