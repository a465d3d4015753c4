"""The way that is chosen: straight to what is known, beside what is not, inside the fence, and always the same."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from companion.core.messages import Vector3
from companion.guidance.choice import PLACES, Craft, Way, choose, ways
from companion.guidance.target import Scatter
from companion.safety.gate import GateLimits

LIMITS = GateLimits(fence_min_m=(-50, -50, -1), fence_max_m=(50, 50, 10), fence_radius_m=60.0, max_speed_m_s=1.0, max_climb_m_s=0.7, max_acceleration_m_s2=3.0, min_height_m=0.5)  # fmt: skip # noqa: E501
CRAFT = Craft(speed_m_s=0.5, acceleration_m_s2=0.8, length_m=1.2, across_m=0.093, up_m=0.093)
STRAIGHT = Way(0.0, 1, 0.4)
_KIND = np.array([0.9, 0.08, 0.02])


def _scatter(distance_m: float, ratio: float, seed: int = 1, height_std_m: float = 0.2) -> Scatter:
    """Places to the East, a metre below, whose ranges are known but for this ratio and directions but for 2 degrees."""
    rng = np.random.default_rng(seed)
    range_m = distance_m * np.exp(rng.normal(0.0, ratio, PLACES))
    azimuth = rng.normal(0.0, math.radians(2.0), PLACES)
    up_m = rng.normal(-1.0, height_std_m, PLACES)
    places_m = np.stack([range_m * np.cos(azimuth), range_m * np.sin(azimuth), up_m], axis=1)
    heading, elevation = rng.normal(0.0, math.radians(1.8), (2, PLACES))
    return Scatter(places_m, heading, elevation, _KIND)


def _chosen(
    scatter: Scatter,
    distance_m: float,
    limits: GateLimits = LIMITS,
    others_m: tuple[Vector3, ...] = (),
    before: Way = STRAIGHT,
    craft: Craft = CRAFT,
) -> Way:
    near_m = min(distance_m, 1.7)
    return choose(
        scatter,
        (distance_m, 0.0, -1.0),
        (0.0, 0.0, 0.0),
        near_m,
        craft=craft,
        limits=limits,
        others_m=others_m,
        before=before,
    )


@pytest.mark.parametrize(("distance_m", "lead_deg", "weave"), [(15.0, 0.0, 0.4), (8.0, 0.0, 0.5), (4.0, 10.0, 0.5)])
def test_to_a_place_that_is_known_it_flies_nearly_straight(distance_m: float, lead_deg: float, weave: float) -> None:
    for seed in range(8):
        way = _chosen(_scatter(distance_m, 0.02, seed), distance_m)
        assert math.degrees(way.lead_rad) < lead_deg + 0.1 and way.weave <= weave


def test_beside_a_place_whose_range_is_not_known_once_that_costs_little() -> None:
    leads = [_chosen(_scatter(4.0, 0.6, seed), 4.0).lead_rad for seed in range(12)]
    assert np.mean(leads) > math.radians(5.0)
    afar = [_chosen(_scatter(15.0, 0.6, seed), 15.0).lead_rad for seed in range(12)]
    assert np.mean(afar) < np.mean(leads), "from afar the way round is long, and there is time to look later"


def test_the_side_that_is_flown_is_changed_for_more_than_another_way_to_the_same() -> None:
    scatters = [s for s in (_scatter(4.0, 0.6, seed) for seed in range(20)) if _chosen(s, 4.0).lead_rad > 0.0]
    assert len(scatters) >= 4
    for side in (1, -1):
        kept = [_chosen(s, 4.0, before=Way(0.0, side, 0.4)).side == side for s in scatters]
        assert np.mean(kept) > 0.8


@pytest.mark.parametrize("up_m", [0.0, 0.093])
def test_a_helix_without_width_is_a_line(up_m: float) -> None:
    """`mission.lateral_weave_m` may be 0."""
    way = _chosen(_scatter(4.0, 0.6), 4.0, craft=replace(CRAFT, across_m=0.0, up_m=up_m))
    assert way in ways(1) or way in ways(1, (1.0,))


@pytest.mark.parametrize("side", [1, -1])
def test_to_the_side_away_from_the_fence_and_from_other_robots(side: int) -> None:
    scatter = next(s for s in (_scatter(4.0, 0.6, k) for k in range(12)) if _chosen(s, 4.0).lead_rad > 0.0)
    near = 0.65  # of a fence in which the straight way just fits
    low, high = ((-50.0, -near, -1.0), (50.0, 50.0, 10.0)) if side > 0 else ((-50.0, -50.0, -1.0), (50.0, near, 10.0))
    fenced = replace(LIMITS, fence_min_m=low, fence_max_m=high)
    for before in (STRAIGHT, replace(STRAIGHT, side=-1), Way(math.radians(20.0), -side, 0.4)):
        way = _chosen(scatter, 4.0, fenced, before=before)
        assert way.lead_rad == 0.0 or way.side == side
    robot = (1.6, -side * 1.5, 0.0)
    way = _chosen(scatter, 4.0, others_m=(robot,), before=Way(math.radians(30.0), -side, 0.4))
    assert way.lead_rad == 0.0 or way.side == side


def test_where_no_way_stays_inside_it_takes_one_that_leaves_least() -> None:
    outside = replace(LIMITS, fence_min_m=(-2.0, -2.0, -1.0), fence_max_m=(1.0, 2.0, 10.0))
    assert _chosen(_scatter(8.0, 0.3), 8.0, outside) in ways(1)


def test_the_same_belief_gives_the_same_way_and_it_does_not_flutter() -> None:
    changes = 0
    way = STRAIGHT
    for seed in range(20):
        scatter = _scatter(4.0, 0.3, seed)
        first = _chosen(scatter, 4.0, before=way)
        assert first == _chosen(scatter, 4.0, before=way)
        assert _chosen(scatter, 4.0, before=first) == first, "what was chosen stays, of the same belief"
        changes += first.side != way.side
        way = first
    assert changes <= 4


def test_two_sources_are_told_apart_by_a_wider_way_than_one() -> None:
    one, other = _scatter(5.0, 0.03, 1), _scatter(9.0, 0.03, 2)
    half = PLACES // 2
    places_m = np.concatenate([one.p_local_enu_m[:half], other.p_local_enu_m[half:]])
    both = Scatter(places_m, one.heading_rad, one.elevation_rad, _KIND)
    assert _chosen(both, 5.0).lead_rad >= _chosen(one, 5.0).lead_rad == 0.0


def test_a_rover_has_no_height_to_weave_in_and_weaves_across_as_wide_as_it_can() -> None:
    drives = replace(CRAFT, up_m=0.0)
    way = choose(
        _scatter(5.0, 0.3),
        (5.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        1.7,
        craft=drives,
        limits=LIMITS,
        others_m=(),
        before=STRAIGHT,
    )
    assert way.weave == 1.0


def test_it_takes_a_millisecond_or_two() -> None:
    scatter, took_s = _scatter(6.0, 0.3), list[float]()
    for _ in range(60):
        begun = time.thread_time()
        _chosen(scatter, 6.0)
        took_s.append(time.thread_time() - begun)
    assert min(took_s) < 0.004
