"""What is known of the robots, and above all of the target: packets and datagrams, bearings, path that gave none."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Final

from companion.camera.sighting import TagFrame
from companion.config.schema import Config
from companion.core.clock import age_s
from companion.core.event_clock import EventClock
from companion.core.inputs import Event
from companion.core.messages import Vector3, VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import TARGET
from companion.flight.camera_lead import CameraLead
from companion.flight.course import Course
from companion.flight.limits import gate_limits
from companion.flight.local_frame import LocalFrame
from companion.flight.records import target_report
from companion.guidance.detour import Detour
from companion.guidance.ground import above_horizon
from companion.guidance.steering import Aim
from companion.guidance.targets import Targets
from companion.neighbours.naming import named
from companion.neighbours.neighbour import Neighbour
from companion.radio.card import ChannelSample
from companion.sensing.iterations import SarIterations
from companion.sensing.records import Iteration

_log = logging.getLogger(__name__)
_BEARING_LATE_S: Final = 1.4
"""With the period of the apertures, half a second, and a tick: old within two seconds of a worker that hangs."""
_REFUSED_S: Final = 10.0
"""Iterations that were refused are told of no more often: of a vehicle that stands where it is measured there are four
a second, for hours. The flight's log holds each."""
_GRANTED: Final = 2.0
"""Apertures' worth of path after a hold: the first may still lack what was missing before."""
_FOUND: Final = 0.2
"""Bearings that say little each, but agree on a source of this probability, steer too: where images are loud no source
has more for long, and nothing is learnt by standing still."""


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
        chooses_motion: bool = True,
    ) -> None:
        self._config = config.aperture
        self._clock = clock
        self._recorder = recorder
        self._sar = sar
        self._course = course
        self._frame = frame
        self._drives = config.mission.vehicle == "rover"
        self._neighbours = neighbours
        self._target = config.target
        self.targets: Final = Targets(
            neighbours=neighbours,
            target=config.target,
            arrival_range_m=config.mission.arrival_range_m,
            arrival_confidence=config.mission.arrival_confidence,
            limits=gate_limits(config),
            drift=config.pose_drift,
            antenna_heights_m={
                peer.id: peer.antenna_height_m for peer in config.peers if peer.antenna_height_m is not None
            },
            scatters=chooses_motion,
        )
        self.camera: CameraLead | None = None
        """Where one is configured."""
        if config.tag_camera.enabled:
            self.camera = CameraLead(
                config=config, clock=clock, recorder=recorder, neighbours=neighbours, radio=self.targets.found
            )
        self._detour = Detour(gate_limits(config))
        self._packet_ns: dict[int, int] = {}
        self._packets = 0
        self._blind_legs = 0.0
        self._flown_ns = 0
        """The end of the path that blind legs have been counted of: apertures overlap."""
        self._tries = 0
        self._refused = 0
        self._told_ns: int | None = None
        """When somebody was told of a refused iteration; so many more were refused since."""
        self._iterations: dict[int, Iteration] = {}

    @property
    def neighbour(self) -> Neighbour:
        """The target as a sender of datagrams."""
        return self._neighbours[self._target]

    @property
    def robots(self) -> tuple[Neighbour, ...]:
        """All that may be flown to, the target among them."""
        return tuple(self._neighbours.values())

    def named(self, word: str) -> Neighbour:
        """The robot of that name or id. Raises CompanionError where there is none, or where it may mean two."""
        return named(word, self.robots)

    def select(self, peer: int) -> None:
        """Another robot is the target from now on: its bearings, its silence and its nearness count, and path that
        gave no bearing of the one before counts no more."""
        if peer == self._target:
            return
        self._target = peer
        self.targets.select(peer)
        self._detour.begin_anew()
        if self.camera is not None:
            self.camera.select()
        self._packets, self._blind_legs, self._tries = 0, 0.0, 0
        _log.info("the target is %s", self.neighbour.name)

    def aim(self, vehicle: VehicleState) -> Aim | None:
        """Where to fly; None while nothing is known of the target. The camera's word stands before the radio's."""
        p_m = vehicle.p_local_enu_m
        if p_m is None:
            return None
        seen = None if self.camera is None else self.camera.aim(self._target, p_m)
        return seen or self._detour.aim(p_m) or self.targets.aim(p_m)

    def is_near(self, p_m: Vector3) -> bool:
        """At each tick: whether the target is within the range of arrival of a place, by who leads."""
        by_radio = self.targets.is_near(p_m)
        seen = None if self.camera is None else self.camera.is_near(self._target, p_m)
        return by_radio if seen is None else seen

    def places(self) -> tuple[Vector3, ...]:
        """What set points are kept away from: where the radio knows robots, and where the camera sees them."""
        return self.targets.places() + (() if self.camera is None else self.camera.known_places())

    def others(self) -> tuple[Vector3, ...]:
        """Of those, the robots that are not flown to."""
        return self.targets.others() + (() if self.camera is None else self.camera.known_places(self._target))

    def take_tags(self, frame: TagFrame) -> None:
        """The camera has looked. While it leads, path without a bearing of the radio is not blind. An image without a
        tag decides nothing: it is in no log."""
        if self.camera is None:
            return
        self.camera.take(frame)
        if frame.tags and self.camera.place(self._target) is not None and self._sar.is_measuring:
            self._blind_legs, self._tries = 0.0, 0
            self._course.report(Event.BEARING)

    def follow(self, vehicle: VehicleState) -> None:
        """At each tick: where the vehicle is."""
        if self.camera is not None:
            self.camera.follow(vehicle)
        if vehicle.p_local_enu_m is None or not self._sar.is_measuring:
            self._detour.begin_anew()
        else:
            self._detour.follow(self._clock.now_ns(), vehicle.p_local_enu_m, self.targets.place())

    def shift(self, delta_enu_m: Vector3) -> None:
        """The autopilot's local frame was set anew: all places in it are `delta_enu_m` elsewhere."""
        self.targets.shift(delta_enu_m)
        self._detour.begin_anew()
        if self.camera is not None:
            self.camera.shift(delta_enu_m)

    def heard(self, sample: ChannelSample) -> None:
        """A packet was measured."""
        self._packet_ns[sample.peer] = sample.t_mono_ns
        self._packets += sample.peer == self._target

    def add_iteration(self, iteration: Iteration) -> None:
        """A SAR iteration has ended."""
        bearing = iteration.bearing()
        steers = False
        if bearing is not None:
            bearing = above_horizon(bearing) if self._drives else bearing
            target = self.targets.add(iteration.peer, bearing, self._frame.ground_m)
            self._recorder.record(TARGET, bearing.t_mono_ns, target_report(iteration, bearing, target))
            steers = bearing.reliability >= self._config.min_reliability or target.probability >= _FOUND
        if iteration.estimate is not None:
            self._iterations[iteration.peer] = iteration
        if iteration.peer == self._target:
            self._note(iteration, steers)

    @property
    def packets(self) -> int:
        """Heard since the newest iteration."""
        return self._packets

    @property
    def iteration(self) -> Iteration | None:
        """The newest of the target that gave an estimate, whether it may steer or not."""
        return self._iterations.get(self._target)

    @property
    def blind_legs(self) -> float:
        """Apertures' worth of path since the newest bearing that may steer."""
        return self._blind_legs

    @property
    def tries(self) -> int:
        """Times the vehicle has held since then."""
        return self._tries

    def packet_age_s(self, peer: int | None = None) -> float:
        """Of a robot; of the target where none is given."""
        return age_s(self._packet_ns.get(self._target if peer is None else peer), self._clock.now_ns())

    def datagram_age_s(self, peer: int | None = None) -> float:
        """Of a robot; of the target where none is given."""
        return age_s(self._neighbours[self._target if peer is None else peer].heard_ns, self._clock.now_ns())

    def age_s(self) -> float:
        """Since the target was last heard, by its packets and by its datagrams, whichever is older."""
        return max(self.packet_age_s(), self.datagram_age_s())

    def is_stale(self) -> bool:
        """Whether what is known of the target's direction is old: it is silent, legs gave none, or the worker hangs or
        is gone."""
        if self.iteration is None:
            return True
        late = self._sar.waiting_s() > _BEARING_LATE_S or not self._sar.is_ready
        return self.age_s() > self._config.silent_s or late or self._blind_legs >= self._config.blind_legs

    def begin_anew(self) -> None:
        """A mission begins: bearings and places of the one before count no more."""
        self.targets.forget()
        self._iterations.clear()
        if self.camera is not None:
            self.camera.begin_anew()
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
        fresh_ns = iteration.end_ns - max(iteration.start_ns, self._flown_ns)
        self._blind_legs += max(0, fresh_ns) / max(1, iteration.end_ns - iteration.start_ns)
        self._flown_ns = max(self._flown_ns, iteration.end_ns)
        if iteration.estimate is None:
            self._tell_refusal(iteration)
            return
        if steers and self._sar.is_measuring:  # not of a flight that was broken off since
            self._blind_legs, self._tries = 0.0, 0
            self._course.report(Event.BEARING)

    def _tell_refusal(self, iteration: Iteration) -> None:
        now_ns = self._clock.now_ns()
        if age_s(self._told_ns, now_ns) < _REFUSED_S:
            self._refused += 1
            return
        before = f", as were {self._refused} before" if self._refused else ""
        _log.warning("SAR iteration %d refused: %s%s", iteration.number, iteration.refusal, before)
        self._refused, self._told_ns = 0, now_ns
