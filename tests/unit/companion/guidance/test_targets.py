"""Where the neighbours are known to be."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.core.messages import Vector3
from companion.guidance.targets import Targets
from companion.neighbours.neighbour import Neighbour
from companion.sensing.records import Bearing


def _bearing(from_m: Vector3, target_m: Vector3) -> Bearing:
    dx, dy, dz = (t - f for t, f in zip(target_m, from_m, strict=True))
    polar = math.acos(dz / math.hypot(dx, dy, dz))
    return Bearing(
        t_mono_ns=1,
        p_local_enu_m=from_m,
        azimuth_rad=math.atan2(dy, dx),
        polar_rad=polar,
        azimuth_std_rad=math.radians(1),
        polar_std_rad=math.radians(2),
        target_p_enu_m=(0.0, 0.0, 0.0),
        target_boot=9,
        reliability=0.9,
    )


class _Neighbour(Neighbour):
    """One whose newest pose a test sets."""

    moved_m: Vector3 = (0.0, 0.0, 0.0)
    boot = 9

    def newest_pose(self) -> tuple[int, Vector3] | None:
        return self.boot, self.moved_m


def test_where_a_neighbour_is_known_to_be_follows_what_it_says_of_itself() -> None:
    beacon = _Neighbour(2, "beacon")
    targets = Targets({2: beacon}, target=2, arrival_range_m=2.0, arrival_confidence=0.9)
    assert targets.places() == () and not targets.is_near((0.0, 0.0, 1.5))
    for turn in range(8):  # around it
        targets.add(2, _bearing((4.0 + math.cos(turn), math.sin(turn), 1.5), (4.0, 0.0, 0.5)), 0.0)
    (place,) = targets.places()
    assert place == pytest.approx((4.0, 0.0, 0.5), abs=0.6)
    beacon.moved_m = (1.0, 0.0, 0.0)
    assert targets.places()[0] == pytest.approx((5.0, 0.0, 0.5), abs=0.6)
    assert targets.is_near((4.9, 0.0, 0.6)) and not targets.is_near((0.0, 0.0, 1.5))
    beacon.boot = 10  # it was started again: its frame is another one
    assert targets.places() == ()
    targets.forget()
    assert targets.target is None


def test_one_bearing_tells_a_direction_and_no_place() -> None:
    targets = Targets({2: _Neighbour(2, "beacon")}, target=2, arrival_range_m=2.0, arrival_confidence=0.9)
    assert targets.aim((0.0, 0.0, 1.5)) is None
    targets.add(2, _bearing((0.0, 0.0, 1.5), (4.0, 0.0, 0.5)), 0.0)
    aim = targets.aim((0.0, 0.0, 1.5))
    assert aim is not None and aim.azimuth_rad == pytest.approx(0.0, abs=0.2)
    assert targets.places() == () and targets.target is not None


def test_near_is_what_new_packets_have_confirmed() -> None:
    """A whole aperture of them; until then, and as soon as one does not, nothing has arrived."""
    targets = Targets({2: _Neighbour(2, "beacon")}, target=2, arrival_range_m=2.0, arrival_confidence=0.9)
    for turn in range(6):
        targets.add(2, replace(_bearing((4.0 + math.cos(turn), math.sin(turn), 1.5), (4.0, 0.0, 0.5)), fresh=1.0), 0.0)
    assert targets.is_near((4.9, 0.0, 1.0))
    targets.add(2, replace(_bearing((9.0, 0.0, 1.5), (4.0, 0.0, 0.5)), fresh=0.2), 0.0)
    targets.add(2, replace(_bearing((4.0, 1.0, 1.5), (4.0, 0.0, 0.5)), fresh=0.2), 0.0)
    assert not targets.is_near((4.9, 0.0, 1.0))
