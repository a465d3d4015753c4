"""Where the robots around us are, by their bearings and by what they say of themselves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from companion.core.messages import Vector3
from companion.guidance.choice import PLACES
from companion.guidance.reach import Reach
from companion.guidance.steering import Aim
from companion.guidance.target import Scatter, Target
from companion.guidance.tracker import TargetTracker
from companion.neighbours.neighbour import Neighbour
from companion.safety.gate import GateLimits
from companion.sensing.frame_turn import DRIFT
from companion.sensing.records import Bearing

_KNOWN_STD_M: Final = 1.0
"""A place that is less sure than this keeps nothing at a distance: it may be anywhere,"""
_LIKELY: Final = 0.5
"""and so may one that is less likely than all others together."""
_SURE: Final = 0.75
"""A source that is so likely makes the direction sure: a belief always leaves some to places nobody has looked at."""
_BEYOND: Final = 0.5
"""Of the range of arrival: a robot that far outside the fence can still be come near to from inside."""
_CONFIRMED: Final = 0.35
"""Apertures' worth of new packets over which the target must seem to be within the range of arrival all the time,"""
_CONFIRMED_AMONG_ECHOES: Final = 0.75
"""and where echoes may turn bearings slowly, which looks like a source that is near."""
_KIND: Final = 0.8
"""There are none where a kind room has been so probable"""
_LATELY: Final = 2.0
"""on the average over so many apertures or so."""


class Targets:
    """One tracker for each robot that is heard; `target` is the one that is flown to."""

    def __init__(
        self,
        *,
        neighbours: Mapping[int, Neighbour],
        target: int,
        arrival_range_m: float,
        arrival_confidence: float,
        limits: GateLimits,
        drift: float = DRIFT,
        antenna_heights_m: Mapping[int, float] = MappingProxyType({}),
        scatters: bool = False,
    ) -> None:
        """`drift` is the share of the way by which poses part from the truth; `antenna_heights_m` by robot how high
        above the ground its antenna is, of those that stand on it; with `scatters` an aim tells a few places
        where the target may be."""
        self._scatters = scatters
        self._drift = drift
        self._antenna_heights_m = antenna_heights_m
        self._reach = Reach(limits, _BEYOND * arrival_range_m)
        self._inside = self._new_tracker(target).on_condition()
        """What bearings of the target say on condition that it can be flown to."""
        self._instead: Target | None = None
        """The likeliest source on that condition, where the likeliest of all cannot be flown to."""
        self._arrival_range_m = arrival_range_m
        self._arrival_confidence = arrival_confidence
        self._near = self._new = 0.0
        """Apertures' worth of new packets for which the target has seemed near; and those not looked at yet."""
        self._kind = 0.0
        """How probably the room has been a kind one lately."""
        self._scatter: Scatter | None = None
        """A few places of what steers."""
        self._nearer_m: Vector3 | None = None
        """Another source that the target must be, if it is there: what is likeliest is then an image of it."""
        self._neighbours = neighbours
        self._target = target
        self._trackers: dict[int, TargetTracker] = {}
        self._found: dict[int, Target] = {}

    def forget(self) -> None:
        self._trackers.clear()
        self._near = self._new = self._kind = 0.0
        self._nearer_m = self._instead = self._scatter = None
        self._inside = self._new_tracker(self._target).on_condition()
        self._found.clear()

    def shift(self, delta_enu_m: Vector3) -> None:
        """The autopilot's local frame was set anew: all places in it are `delta_enu_m` elsewhere."""
        for peer, tracker in self._trackers.items():
            tracker.shift(delta_enu_m)
            self._found[peer] = tracker.target()
            if peer == self._target:
                self._nearer_m = tracker.nearer_source()
                self._inside.shift(delta_enu_m)
                self._instead = self._instead and self._inside.target()
                self._scatter = self._scattered(self._inside if self._instead else tracker)

    def add(self, peer: int, bearing: Bearing, ground_m: float) -> Target:
        """Takes a bearing; what is known of that robot now. The ground is at `ground_m` (Up)."""
        tracker = self._trackers.setdefault(peer, self._new_tracker(peer))
        found = self._found[peer] = tracker.add(bearing, ground_m)
        if peer == self._target:
            self._nearer_m = tracker.nearer_source()
            self._inside.take(bearing, ground_m)
            can_be_flown_to = self._reach(np.array([found.place(bearing.target_p_enu_m)]))[0]
            self._instead = None if can_be_flown_to else self._inside.target()
            self._scatter = self._scattered(tracker if can_be_flown_to else self._inside)
            self._new += bearing.fresh
            self._kind += min(1.0, bearing.fresh / _LATELY) * (float(tracker.rooms()[0]) - self._kind)
        return found

    def select(self, peer: int) -> None:
        """Another robot is flown to from now on. What is known of all of them stays; that the one before seemed near
        says nothing of this one."""
        if peer == self._target:
            return
        self._target = peer
        self._near = self._new = self._kind = 0.0
        tracker = self._trackers.get(peer)
        self._nearer_m = None if tracker is None else tracker.nearer_source()
        self._inside = (tracker or self._new_tracker(peer)).on_condition()
        self._instead = None
        self._scatter = None if tracker is None else self._scattered(tracker)

    def _scattered(self, tracker: TargetTracker) -> Scatter | None:
        return tracker.scatter(PLACES) if self._scatters else None

    def _new_tracker(self, peer: int) -> TargetTracker:
        return TargetTracker(self._reach, self._drift, self._antenna_heights_m.get(peer))

    @property
    def target(self) -> Target | None:
        return self._found.get(self._target)

    def place(self) -> Vector3 | None:
        """Where the target is thought to be now; None while that is not known."""
        return None if self.target is None else self._place(self._target)

    def found(self, peer: int) -> Target | None:
        """What is known of a robot; None before its first bearing."""
        return self._found.get(peer)

    def aim(self, p_local_enu_m: Vector3) -> Aim | None:
        """Where the target is from a place; None while nothing is known of it."""
        target = self.target
        place = self._place(self._target) if target is not None else None
        if target is None or place is None:
            return None
        scatter = self._scatter
        if self._nearer_m is not None:  # it is looked at again from near, whatever is believed
            scatter = None
            place = _sum(place, _minus(self._nearer_m, target.origin_local_enu_m))
        elif self._instead is not None:
            place = _sum(place, _minus(self._instead.origin_local_enu_m, target.origin_local_enu_m))
            target = self._instead
        east, north = place[0] - p_local_enu_m[0], place[1] - p_local_enu_m[1]
        return Aim(
            azimuth_rad=math.atan2(north, east),
            distance_m=math.hypot(east, north),
            distance_std_m=target.range_std_m,
            sureness=min(1.0, target.probability / _SURE),
            above_m=place[2] - p_local_enu_m[2],
            scatter=scatter,
        )

    def is_near(self, p_local_enu_m: Vector3) -> bool:
        """Each tick: whether the target, where its newest datagram says it has come to, is within the range of arrival:
        surely, and for as long as it takes to see that with new packets."""
        new, self._new = self._new, 0.0
        if self._near + new <= 0.0:  # nothing to look at since it last seemed far
            return False
        self._near = self._near + new if self._seems_near(p_local_enu_m) else 0.0
        return self._near >= (_CONFIRMED if self._kind >= _KIND else _CONFIRMED_AMONG_ECHOES)

    def _seems_near(self, p_local_enu_m: Vector3) -> bool:
        newest = self._neighbours[self._target].newest_pose() if self._target in self._found else None
        if newest is None or newest[0] != self._found[self._target].boot or self._nearer_m is not None:
            return False
        near = self._trackers[self._target].within(p_local_enu_m, newest[1], self._arrival_range_m)
        return near >= self._arrival_confidence

    def places(self) -> tuple[Vector3, ...]:
        """Where robots are known to be, in the autopilot's local frame."""
        return self._known_places(self._found)

    def others(self) -> tuple[Vector3, ...]:
        """Of those, the ones that are not flown to."""
        return self._known_places(peer for peer in self._found if peer != self._target)

    def _known_places(self, peers: Iterable[int]) -> tuple[Vector3, ...]:
        known = (
            self._place(peer)
            for peer in peers
            if self._found[peer].range_std_m < _KNOWN_STD_M and self._found[peer].probability > _LIKELY
        )
        return tuple(place for place in known if place is not None)

    def _place(self, peer: int) -> Vector3 | None:
        found = self._found[peer]
        newest = self._neighbours[peer].newest_pose()
        if newest is None or newest[0] != found.boot:
            return None
        return found.place(newest[1])


def _sum(a: Vector3, b: Vector3) -> Vector3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _minus(a: Vector3, b: Vector3) -> Vector3:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]
