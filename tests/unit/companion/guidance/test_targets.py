"""Where the neighbours are known to be."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.core.messages import Vector3
from companion.guidance.choice import PLACES
from companion.guidance.target import Scatter
from companion.guidance.targets import Targets
from companion.neighbours.neighbour import Neighbour
from companion.safety.gate import GateLimits
from companion.sensing.records import Bearing
from wsr.directions import Peak

_LIMITS = GateLimits(
    fence_min_m=(-20.0, -20.0, -1.0),
    fence_max_m=(20.0, 20.0, 5.0),
    fence_radius_m=30.0,
    max_speed_m_s=1.0,
    max_climb_m_s=0.7,
    max_acceleration_m_s2=3.0,
    min_height_m=0.5,
)


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
    targets = Targets(neighbours={2: beacon}, target=2, arrival_range_m=2.0, arrival_confidence=0.9, limits=_LIMITS)
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


@pytest.mark.parametrize(("reliability", "needed"), [(0.9, 0.4), (0.03, 0.8)])
def test_where_images_are_loud_a_target_must_seem_near_for_longer(reliability: float, needed: float) -> None:
    targets = Targets(
        neighbours={2: _Neighbour(2, "beacon")},
        target=2,
        arrival_range_m=2.0,
        arrival_confidence=0.9,
        limits=_LIMITS,
    )
    for turn in range(40):  # around it, from near; nobody asks yet
        here_m = (4.0 + math.cos(turn), math.sin(turn), 1.5)
        targets.add(2, replace(_bearing(here_m, (4.0, 0.0, 0.5)), reliability=reliability, fresh=0.5), 0.0)
    assert not targets.is_near((0.0, 0.0, 1.5))
    seen = 0.0
    while not targets.is_near(here_m) and seen < 2.0:
        targets.add(2, replace(_bearing(here_m, (4.0, 0.0, 0.5)), reliability=reliability, fresh=0.1), 0.0)
        seen += 0.1
    assert needed - 0.05 < seen < needed + 0.15  # sums of tenths


def test_one_bearing_tells_a_direction_and_no_place() -> None:
    targets = Targets(
        neighbours={2: _Neighbour(2, "beacon")}, target=2, arrival_range_m=2.0, arrival_confidence=0.9, limits=_LIMITS
    )
    assert targets.aim((0.0, 0.0, 1.5)) is None
    targets.add(2, _bearing((0.0, 0.0, 1.5), (4.0, 0.0, 0.5)), 0.0)
    aim = targets.aim((0.0, 0.0, 1.5))
    assert aim is not None and aim.azimuth_rad == pytest.approx(0.0, abs=0.2)
    assert targets.places() == () and targets.target is not None


def test_a_few_places_go_with_the_aim_and_are_others_after_each_bearing() -> None:
    targets = Targets(
        neighbours={2: _Neighbour(2, "beacon")},
        target=2,
        arrival_range_m=2.0,
        arrival_confidence=0.9,
        limits=_LIMITS,
        scatters=True,
    )
    seen = list[Scatter]()
    for turn in range(6):
        here_m = (4.0 + math.cos(turn), math.sin(turn), 1.5)
        targets.add(2, replace(_bearing(here_m, (4.0, 0.0, 0.5)), fresh=1.0), 0.0)
        first, again = targets.aim(here_m), targets.aim((0.0, 0.0, 1.5))
        assert first is not None and again is not None and first.scatter is not None
        assert first.scatter is again.scatter
        seen.append(first.scatter)
    assert len(set(map(id, seen))) == 6
    assert seen[-1].p_local_enu_m.shape == (PLACES, 3) and seen[-1].rooms.sum() == pytest.approx(1.0, abs=1e-3)
    assert np.median(seen[-1].p_local_enu_m, axis=0) == pytest.approx([4.0, 0.0, 0.5], abs=0.4)
    targets.shift((5.0, 0.0, 0.0))
    moved = targets.aim((0.0, 0.0, 1.5))
    assert moved is not None and moved.scatter is not None
    assert np.median(moved.scatter.p_local_enu_m, axis=0) == pytest.approx([9.0, 0.0, 0.5], abs=0.4)


def test_near_is_what_new_packets_have_confirmed() -> None:
    """Two more apertures; until then, and as soon as it does not seem near, nothing has arrived."""
    targets = Targets(
        neighbours={2: _Neighbour(2, "beacon")}, target=2, arrival_range_m=2.0, arrival_confidence=0.9, limits=_LIMITS
    )
    for turn in range(6):
        targets.add(2, replace(_bearing((4.0 + math.cos(turn), math.sin(turn), 1.5), (4.0, 0.0, 0.5)), fresh=1.0), 0.0)
    assert targets.is_near((4.9, 0.0, 1.0))
    assert not targets.is_near((9.0, 0.0, 1.0))
    assert not targets.is_near((4.9, 0.0, 1.0))
    for seen in range(2):
        assert not targets.is_near((4.9, 0.0, 1.0)), seen
        targets.add(2, replace(_bearing((4.0, 1.0, 1.5), (4.0, 0.0, 0.5)), fresh=0.2), 0.0)
    assert targets.is_near((4.9, 0.0, 1.0))


def _seen_from(targets: Targets, from_m: Vector3, image_m: Vector3, robot_m: Vector3) -> None:
    """A bearing of the louder of two, with the other as another path: the robot is behind something, at a fifth of its
    amplitude, and the wall reflects half."""
    powers = {robot_m: (0.2 / math.dist(from_m, robot_m)) ** 2, image_m: (0.5 / math.dist(from_m, image_m)) ** 2}
    faint_m, loud_m = sorted(powers, key=lambda place_m: powers[place_m])
    loud, faint = _bearing(from_m, loud_m), _bearing(from_m, faint_m)
    path = Peak(
        azimuth_rad=faint.azimuth_rad,
        polar_rad=faint.polar_rad,
        power=0.1,
        relative_power=powers[faint_m] / powers[loud_m],
    )
    targets.add(2, replace(loud, others=(path,), reliability=0.5, fresh=0.4), 0.0)


@pytest.mark.parametrize("is_fenced", [True, False])
def test_an_image_behind_the_wall_is_louder_but_the_robot_in_the_room_is_flown_to(is_fenced: bool) -> None:
    """The fence keeps to the room, so nobody could fly to the image. Without it the vehicle flies there."""
    image_m, robot_m = (0.0, -12.0, 0.5), (9.0, 0.0, 0.5)
    room = replace(_LIMITS, fence_min_m=(-3.0, -4.0, -1.0), fence_max_m=(12.0, 4.0, 3.0))
    targets = Targets(
        neighbours={2: _Neighbour(2, "beacon")},
        target=2,
        arrival_range_m=2.0,
        arrival_confidence=0.9,
        limits=room if is_fenced else _LIMITS,
    )
    x, y = 0.0, 0.0
    for step in range(120):
        here_m = (x + 0.5 * math.sin(1.3 * step), y, 1.5 + 0.15 * math.cos(1.3 * step))
        _seen_from(targets, here_m, image_m, robot_m)
        aim = targets.aim(here_m)
        assert aim is not None
        x, y = x + 0.25 * math.cos(aim.azimuth_rad), y + 0.25 * math.sin(aim.azimuth_rad)
        y = max(y, -4.0) if is_fenced else y
        if math.dist((x, y), (robot_m if is_fenced else image_m)[:2]) < 1.5:
            return
    pytest.fail(f"ended at {x:.1f}, {y:.1f}")


def test_where_nothing_seen_can_be_flown_to_it_flies_towards_it_all_the_same() -> None:
    tight = replace(_LIMITS, fence_min_m=(-1.0, -1.0, -1.0), fence_max_m=(1.0, 1.0, 3.0), fence_radius_m=1.0)
    targets = Targets(
        neighbours={2: _Neighbour(2, "beacon")}, target=2, arrival_range_m=0.1, arrival_confidence=0.9, limits=tight
    )
    for step in range(12):
        here_m = (0.6 * math.cos(step), 0.6 * math.sin(step), 1.5)
        targets.add(2, replace(_bearing(here_m, (0.0, 14.0, 0.5)), fresh=0.5), 0.0)
    aim = targets.aim(here_m)
    assert aim is not None and aim.azimuth_rad == pytest.approx(math.pi / 2, abs=0.4)


def test_another_robot_is_flown_to_by_what_was_heard_of_it_on_the_way() -> None:
    """Both are tracked all the time; that one seemed near says nothing of the other."""
    alpha_m, beta_m = (4.0, 0.0, 0.5), (0.0, 5.0, 0.5)
    targets = Targets(
        neighbours={2: _Neighbour(2, "alpha"), 3: _Neighbour(3, "beta")},
        target=2, arrival_range_m=2.0, arrival_confidence=0.9, limits=_LIMITS,
    )  # fmt: skip
    for turn in range(8):
        place_m = (2.0 + 2.0 * math.cos(turn), 2.5 + 2.0 * math.sin(turn), 1.5)
        for peer, robot_m in ((2, alpha_m), (3, beta_m)):
            targets.add(peer, replace(_bearing(place_m, robot_m), fresh=1.0), 0.0)
    here_m = (4.0, 1.0, 1.0)
    assert targets.is_near(here_m)
    assert targets.others() == pytest.approx(np.array([beta_m]), abs=0.8)
    targets.select(3)
    aim = targets.aim(here_m)
    assert aim is not None and aim.azimuth_rad == pytest.approx(math.atan2(4.0, -4.0), abs=0.15)
    assert targets.others() == pytest.approx(np.array([alpha_m]), abs=0.8)
    assert targets.found(2) is not None and targets.found(3) is targets.target
    targets.add(3, replace(_bearing((0.0, 4.0, 1.0), beta_m), fresh=1.0), 0.0)
    assert not targets.is_near(here_m) and targets.is_near((0.0, 4.2, 1.0)) is False
    targets.add(3, replace(_bearing((0.0, 4.0, 1.0), beta_m), fresh=1.0), 0.0)
    assert targets.is_near((0.0, 4.2, 1.0))


def test_a_robot_of_which_nothing_is_known_yet_is_searched_for() -> None:
    targets = Targets(
        neighbours={2: _Neighbour(2, "alpha"), 3: _Neighbour(3, "beta")},
        target=2, arrival_range_m=2.0, arrival_confidence=0.9, limits=_LIMITS,
    )  # fmt: skip
    targets.add(2, _bearing((0.0, 0.0, 1.5), (4.0, 0.0, 0.5)), 0.0)
    targets.select(3)
    assert targets.aim((0.0, 0.0, 1.5)) is None and not targets.is_near((0.0, 0.0, 1.5))
    targets.select(2)
    assert targets.aim((0.0, 0.0, 1.5)) is not None
