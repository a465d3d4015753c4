"""Bearings that cross make a position, others do not, and places that explain them as well live on as rivals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from benchmarks.own_world import ranges_m
from companion.guidance import likelihood, regimes, tracker, twins
from companion.guidance.target import Target
from companion.guidance.tracker import TargetTracker
from companion.sensing.frame_turn import FrameTurn
from companion.sensing.records import Bearing
from companion.study.belief import check
from companion.study.chi_square import middle_95
from tests.unit.companion.guidance.stone_soup import SoupWorld, belief_of, nees, state_of
from wsr.directions import Peak
from wsr.geometry import direction

Floats = npt.NDArray[np.float64]


def bearing_to(
    target: np.ndarray,
    place: np.ndarray,
    t_s: float,
    own: np.ndarray | None = None,
    turned: tuple[float, float] = (0, 0),
) -> Bearing:
    """A bearing that is off by `turned` [rad]; `own` is where the target's own poses put it."""
    x, y, z = target - place
    polar_rad = math.acos(z / np.linalg.norm(target - place)) + turned[1]
    own_m = tuple(np.zeros(3) if own is None else own)
    azimuth_rad = math.atan2(y, x) + turned[0]
    return Bearing(
        t_mono_ns=round(t_s * 1e9),
        p_local_enu_m=tuple(place),
        azimuth_rad=azimuth_rad,
        polar_rad=polar_rad,
        azimuth_std_rad=0.02,
        polar_std_rad=0.02,
        target_p_enu_m=own_m,
        target_boot=7,
        reliability=0.9,
    )


def _from_the_side(tracker: TargetTracker, target: np.ndarray, count: int = 7) -> Target:
    for y in range(count):
        found = tracker.add(bearing_to(target, np.array([0.0, float(y), 1.5]), 3 * y))
    return found


def test_bearings_from_the_side_make_a_position() -> None:
    tracker = TargetTracker()
    target = np.array([6.0, 3.0, 0.5])
    assert tracker.add(bearing_to(target, np.array([0.0, 0.0, 1.5]), 0)).range_std_m > 2.0
    found = _from_the_side(tracker, target)
    np.testing.assert_allclose(found.origin_local_enu_m, target, atol=1.0)
    assert found.range_m == pytest.approx(math.dist(target, (0.0, 6.0, 1.5)), rel=0.15)
    assert found.range_std_m < 2.0 and found.probability > 0.9
    error = np.array(found.origin_local_enu_m) - target
    assert error @ np.linalg.solve(np.array(found.covariance_m2), error) < 14.2  # 99.7 % of a chi2 of three


def test_new_particles_leave_a_belief_that_is_sure_as_it_is() -> None:
    """Those that are drawn anew where a bearing points weigh as in any direction, not by the bearing once more."""
    tracker, target, elsewhere = TargetTracker(antenna_height_m=0.5), np.array([6.0, 3.0, 0.5]), []
    for step in range(30):
        place = np.array([1.5 * math.sin(0.7 * step), 0.2 * step, 1.5])
        tracker.add(bearing_to(target, place, 2.0 * step), 0.0)
        elsewhere.append(1.0 - tracker.within(tuple(target), (0.0, 0.0, 0.0), 5.0))
    assert np.mean(elsewhere[15:]) < 2e-3, elsewhere


def test_beyond_the_fence_is_ten_times_less_likely_until_bearings_say_otherwise() -> None:
    """Who flies to a robot expects it within reach. A robot outside is found all the same."""
    bare, fenced, inside = TargetTracker(), TargetTracker(_is_near), TargetTracker(_is_near).on_condition()
    target, place = np.array([14.0, 0.0, 0.5]), np.array([0.0, 0.0, 1.5])
    for belief in (bare, fenced, inside):
        belief.add(bearing_to(target, place, 0.0))
    assert _odds_beyond(bare) / _odds_beyond(fenced) == pytest.approx(10.0, rel=0.2)
    for step in range(1, 12):  # along two sides of it
        place = np.array([min(float(step), 8.0), -max(0.0, step - 8.0), 1.5])
        for belief in (bare, fenced, inside):
            belief.add(bearing_to(target, place, 3.0 * step))
    for belief in (bare, fenced):
        np.testing.assert_allclose(belief.target().origin_local_enu_m, target, atol=1.0)
    assert inside.target().origin_local_enu_m[0] < 10.0


def test_where_all_is_beyond_the_fence_it_says_nothing() -> None:
    """New places weigh as they would without it, so what has moved elsewhere is found there."""
    nowhere = TargetTracker(lambda places_m: np.zeros(len(places_m), bool)).on_condition()
    bare = TargetTracker()
    for step in range(40):
        target = np.array([14.0, 0.0, 0.5] if step < 15 else [6.0, 12.0, 0.5])
        place = np.array([0.1 * step, 4.0 * math.sin(0.5 * step), 1.5])
        for belief in (nowhere, bare):
            belief.add(bearing_to(target, place, 3.0 * step))
    # But for rounding, which may draw others.
    np.testing.assert_allclose(nowhere.target().origin_local_enu_m, bare.target().origin_local_enu_m, atol=0.3)


def _is_near(p_local_enu_m: Floats) -> npt.NDArray[np.bool_]:
    return np.asarray(p_local_enu_m[:, 0] < 10.0)


def _odds_beyond(belief: TargetTracker) -> float:
    inside = float(_is_near(belief.scatter(3000).p_local_enu_m).mean())
    return (1.0 - inside) / inside


def test_the_same_bearings_give_the_same_target() -> None:
    target = np.array([6.0, 3.0, 0.5])
    assert _from_the_side(TargetTracker(), target) == _from_the_side(TargetTracker(), target)


@pytest.mark.parametrize("seed", range(6))
def test_a_flight_straight_at_the_target_is_near_only_when_it_is(seed: int) -> None:
    """Bearings along one line tell no range: beside the vehicle is as good a place as far away."""
    rng = np.random.default_rng(seed)
    tracker, target = TargetTracker(), np.array([14.0, 0.0, 0.3])
    for leg in range(14):
        place = np.array([0.85 * leg, 0.0, 1.5])
        a, p = np.radians(4) * rng.standard_normal(2)
        found = tracker.add(bearing_to(target, place, 3.5 * leg, turned=(a, p)), 0.0)
        if math.dist(target, place) > 2.5:
            assert tracker.within(tuple(place), (0.0, 0.0, 0.0), 2.0) < 0.9, f"near at {14 - 0.85 * leg:.1f} m"
        assert leg < 3 or abs(found.azimuth_rad) < math.radians(25)  # what North may be off, and images
    for turn in range(8):  # around it: now it is near, and that is seen
        place = target + np.array([1.2 * math.cos(turn), 1.2 * math.sin(turn), 0.8])
        # From one level a robot on the ground, and elevations that are all off, look like one below it.
        tracker.add(bearing_to(target, place, 60 + 3 * turn), 0.0)
    assert tracker.within(tuple(place), (0.0, 0.0, 0.0), 2.0) > 0.9


def test_a_range_that_the_wave_front_shows_needs_no_crossing() -> None:
    target, place = np.array([1.5, 0.0, 0.5]), np.array([0.0, 0.0, 1.5])
    bare, ranged = TargetTracker(), TargetTracker()
    for t_s in (0.0, 3.0, 6.0):
        seen = bearing_to(target, place, t_s)
        bare.add(seen)
        ranged.add(replace(seen, range_m=1.9, range_std_m=0.1))
    assert bare.within(tuple(place), (0.0, 0.0, 0.0), 3.0) < 0.8
    assert ranged.within(tuple(place), (0.0, 0.0, 0.0), 3.0) > 0.9


def test_a_bearing_that_disagrees_is_outvoted() -> None:
    tracker, target = TargetTracker(), np.array([14.0, 0.0, 0.3])
    for leg in range(5):
        tracker.add(bearing_to(target, np.array([0.85 * leg, 0.0, 1.5]), 3.5 * leg))
    outlier = bearing_to(target, np.array([0.85 * 5, 0.0, 1.5]), 17.5, turned=(1.2, 0.2))
    assert abs(tracker.add(outlier).azimuth_rad) < math.radians(5)
    # A target that has really gone elsewhere is followed once the new bearings outweigh the old.
    elsewhere = np.array([0.85 * 5, 10.0, 0.3])
    for leg in range(10):
        found = tracker.add(bearing_to(elsewhere, np.array([0.85 * 5, 0.5 * leg, 1.5]), 20 + 3.5 * leg))
    assert found.azimuth_rad == pytest.approx(math.pi / 2, abs=math.radians(10))


def test_two_sources_that_are_seen_in_turn_both_live_on() -> None:
    """The strongest path is now the robot's and now an image's; the other is seen beside it."""
    tracker, sources = TargetTracker(), (np.array([8.0, 2.0, 0.5]), np.array([8.0, -8.0, 0.5]))
    for y in range(6):
        place = np.array([0.0, float(y), 1.5])
        one, other = sources if y % 2 else sources[::-1]
        dx, dy, dz = other - place
        peak = Peak(
            azimuth_rad=math.atan2(dy, dx),
            polar_rad=math.acos(dz / math.dist(other, place)),
            power=0.3,
            relative_power=0.9,
        )
        found = tracker.add(replace(bearing_to(one, place, 3 * y), others=(peak,), reliability=0.0))
    assert found.probability < 0.9
    places = [found.origin_local_enu_m, *(rival.origin_local_enu_m for rival in found.rivals)]
    for source in sources:
        angle = math.atan2(source[1] - 5.0, source[0])
        assert any(abs(math.atan2(p[1] - 5.0, p[0]) - angle) < 0.2 for p in places)


def test_packets_that_counted_before_do_not_count_again() -> None:
    """On the average over places: one belief is a draw of particles."""
    ratios = []
    for east_m in np.linspace(4.0, 8.0, 9):
        target = np.array([east_m, 3.0, 0.5])
        once, often = TargetTracker(), TargetTracker()
        for y in range(4):
            seen = bearing_to(target, np.array([0.0, float(y), 1.5]), 3 * y)
            alone = once.add(seen)
            for _ in range(5):
                again = often.add(replace(seen, fresh=0.2))
        ratios.append(again.range_std_m / alone.range_std_m)
    assert 0.7 < np.exp(np.mean(np.log(ratios))) < 1.7, ratios


def test_a_bearing_without_polar_angle_still_crosses_from_the_side() -> None:
    tracker, target = TargetTracker(), np.array([6.0, 3.0, 0.5])
    for y in range(7):
        flat = bearing_to(target, np.array([0.0, float(y), 1.5]), y)
        found = tracker.add(replace(flat, polar_rad=math.pi / 2, polar_std_rad=math.inf) if y else flat)
    np.testing.assert_allclose(found.origin_local_enu_m[:2], target[:2], atol=1.2)


@pytest.mark.parametrize("antenna_height_m", [None, 0.5])
def test_azimuths_that_never_agree_put_no_target_below(antenna_height_m: float | None) -> None:
    """Once they did: what is right below explains every azimuth, and the vehicle had arrived after ten seconds."""
    tracker = TargetTracker(antenna_height_m=antenna_height_m)
    for number in range(40):
        place = np.array([0.25 * number, 0.0, 1.5])
        away = place + 10.0 * direction(math.radians(137.508 * number), math.pi / 2)
        tracker.add(replace(bearing_to(away, place, 0.5 * number), polar_std_rad=math.inf, power_dbm=-50.0), 0.0)
        assert tracker.within(tuple(place), (0.0, 0.0, 0.0), 2.0) < 0.9, "enough to arrive"


def test_a_rebooted_target_has_another_origin() -> None:
    tracker, target = TargetTracker(), np.array([6.0, 3.0, 0.5])
    _from_the_side(tracker, target)
    found = tracker.add(replace(bearing_to(target, np.array([1.0, 3.0, 1.5]), 60), target_boot=8))
    assert found.boot == 8 and found.range_std_m > 2.0


def test_a_frame_that_was_set_anew_takes_the_target_along() -> None:
    tracker, target = TargetTracker(), np.array([6.0, 3.0, 0.5])
    before = _from_the_side(tracker, target)
    tracker.shift((1.0, -2.0, 0.5))
    assert np.subtract(tracker.target().origin_local_enu_m, before.origin_local_enu_m) == pytest.approx((1, -2, 0.5))


def test_a_local_frame_that_wanders_takes_the_target_along() -> None:
    """The autopilot's estimate moves off by 0.6 m in half a minute, and with it where the target is in its frame."""
    tracker, target, nees = TargetTracker(antenna_height_m=0.5), np.array([6.0, 3.0, 0.5]), list[float]()
    for step in range(90):
        gone = 0.5 - 0.5 * math.cos(math.pi * max(0.0, min(1.0, (step - 30) / 50)))
        around, off_m = math.pi + 0.1 * step, gone * np.array([0.3, -0.3, 0.4])
        place = target + np.array([1.5 * math.cos(around), 1.5 * math.sin(around), 1.0])
        x, y, z = (place + off_m).tolist()
        seen = replace(bearing_to(target, place, 0.6 * step), p_local_enu_m=(x, y, z), fresh=0.25)
        truth_x, truth_y, truth_z = (target + off_m).tolist()
        belief = tracker.add(seen, 0.0)
        nees.append(check(belief, (0.0, 0.0, 0.0), (truth_x, truth_y, truth_z), (x, y, z)).nees)
    assert np.mean(nees[30:]) < 2.5, nees


def test_a_belief_that_ranges_have_misled_finds_back() -> None:
    """Echoes bend waves alike over metres of path: afterwards no particle is left at the right range but new ones. On
    the average over six draws of particles."""
    feigned, target = np.array([3.0, 0.0, 0.8]), np.array([6.0, 0.0, 0.1])
    farthest_m = np.zeros((6, 33))
    for seed, row in enumerate(farthest_m):
        tracker = TargetTracker()
        tracker._rng = np.random.default_rng(seed)
        for step in range(33):
            place, seen = np.array([0.0, 0.3 * (step % 9 - 4), 1.5]), feigned if step < 9 else target
            range_m = math.dist(place, seen)
            bearing = replace(bearing_to(seen, place, 0.6 * step), fresh=0.5)
            found = tracker.add(replace(bearing, range_m=range_m, range_std_m=0.04 * range_m**2), 0.0)
            row[step] = found.whole.range_90_m[1]
    assert farthest_m[:, 8].max() < 4.5 and farthest_m[:, -6:].max(axis=1).mean() > 5.7, farthest_m


def test_a_belief_that_an_image_has_held_for_long_finds_back() -> None:
    """New particles at the right place take some apertures to show: until then they are the lightest."""
    tracker, image, target = TargetTracker(), np.array([1.5, 17.0, 0.5]), np.array([-3.6, 14.6, 0.5])
    for step in range(100):
        away = max(0, step - 60)
        x = -3.5 * math.sin(away / 13)
        place = np.array([x, min(12.0, 3 + 0.3 * step) - min(5.0, 0.2 * away), 1.5 + 0.3 * math.sin(0.7 * step)])
        bearing = bearing_to(target if away else image, place, 0.5 * step)
        found = tracker.add(replace(bearing, fresh=0.4, reliability=0.1), 0.0)
        if step == 60:
            assert found.probability > 0.9 and math.dist(found.origin_local_enu_m, image) < 3.0
    assert found.probability > 0.5 and math.dist(found.origin_local_enu_m, target) < 1.5


ACROSS_RAD, DOWN_RAD = math.radians(2.0), math.radians(2.2)
"""By which bearings of a kind room are off, across and in elevation."""
PRIOR = SoupWorld(ACROSS_RAD, DOWN_RAD, 0.02, ranges_m(np.random.default_rng(0), 100_000))


def _crossing(seed: int, count: int = 14) -> tuple[Floats, list[Bearing]]:
    """A target (3,) drawn from what is believed at first, and bearings of it along two sides of a square: white errors,
    no images, nothing that is off all the time."""
    rng = np.random.default_rng(seed)
    azimuth, elevation = rng.uniform(-math.pi, math.pi), rng.uniform(-0.35, 0.35)
    level = math.cos(elevation)
    unit = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation)])
    target, bearings = np.array([0.0, 0.0, 1.5]) + ranges_m(rng, 1) * unit, []
    for n in range(count):
        gone_m, side_m = 0.9 * n, 0.45 * count
        place = np.array([min(gone_m, side_m), max(0.0, gone_m - side_m), 1.5 + 0.3 * math.sin(n)])
        sine = math.hypot(*(target - place)[:2]) / math.dist(target, place)
        across, down = rng.normal(0.0, [ACROSS_RAD / sine, DOWN_RAD])
        seen = bearing_to(target, place, 2.0 * n, turned=(across, down))
        seen = replace(seen, azimuth_std_rad=0.0, polar_std_rad=0.0, turn=FrameTurn(0.0, 1e-3))
        bearings.append(seen)
    return target, bearings


def _beside_stone_soup(seeds: range) -> tuple[Floats, Floats, Floats]:
    """(S, 3) by how many of the oracle's deviations the means differ: along the level line of sight, across it, up;
    (S, 3) ratios of deviations; (S, 2) NEES of ours and of the oracle's."""
    apart, ratios, of_both = [], [], []
    for seed in seeds:
        target, bearings = _crossing(seed)
        ours = TargetTracker(drift=0.0)
        for bearing in bearings:
            found = ours.add(bearing)
        here, (x, y, z) = bearings[-1].p_local_enu_m, target.tolist()
        mean, covariance = belief_of(bearings, PRIOR, seed)
        east, north = (mean - here)[:2] / math.hypot(*(mean - here)[:2])
        axes = np.array([[east, north, 0.0], [-north, east, 0.0], [0.0, 0.0, 1.0]])
        own, other = (np.diag(axes @ c @ axes.T) ** 0.5 for c in (np.array(found.whole.covariance_m2), covariance))
        apart.append(axes @ (np.array(found.whole.origin_local_enu_m) - mean) / other)
        ratios.append(own / other)
        own_nees = check(found, (0.0, 0.0, 0.0), (x, y, z), here).nees
        of_both.append((own_nees, nees(state_of(mean, covariance), target)))
    return np.array(apart), np.array(ratios), np.array(of_both)


def _as_narrow_a_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """The room is known to be a kind one without images, whose elevations are right, and no particle is placed but by
    what was drawn first and by the walk: what Stone Soup's filter takes for granted. That takes more of them."""
    monkeypatch.setattr(likelihood, "REGIMES", 3 * (regimes.KIND._replace(reported=(1.0, 1.0, 0.0)),))
    monkeypatch.setattr(likelihood, "_SUREST", 1.0 - 1e-12)
    monkeypatch.setattr(regimes, "_PRIOR", np.array([1.0 - 2e-9, 1e-9, 1e-9]))
    monkeypatch.setattr(regimes, "_CHANGES", 0.0)
    monkeypatch.setattr(regimes, "_ELEVATION_RAD", np.full(3, 1e-3))
    monkeypatch.setattr(tracker, "_WALK_M_SQRT_S", PRIOR.wander_m_sqrt_s)
    monkeypatch.setattr(tracker, "_PARTICLES", 8000)
    monkeypatch.setattr(tracker, "_AT_FIRST", 1)
    monkeypatch.setattr(twins, "ALONG", (0.0, 0.0))
    monkeypatch.setattr(twins, "ACROSS", 0.0)
    for constant in ("_BORN", "_MOVED", "_TWIN_RAD"):
        monkeypatch.setattr(tracker, constant, 0.0)


def _expect_the_same(apart: Floats, ratios: Floats) -> None:
    """Of 24 worlds the means differ by 0.9 deviations at most, 0.3 on the average, and deviations by a factor of 1.5,
    in one world 2.3: of 8000 drawn places, some hundreds are left where bearings cross."""
    assert np.all(np.abs(apart) < 1.5), apart
    assert np.all((ratios > 0.5) & (ratios < 3.0)), ratios
    assert np.all(np.sqrt(np.mean(apart**2, axis=0)) < 0.6), apart


def test_of_the_same_model_the_belief_is_stone_soups(monkeypatch: pytest.MonkeyPatch) -> None:
    _as_narrow_a_model(monkeypatch)
    apart, ratios, _ = _beside_stone_soup(range(1))
    _expect_the_same(apart, ratios)


@pytest.mark.long
def test_of_the_same_model_beliefs_are_stone_soups_over_many_worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    _as_narrow_a_model(monkeypatch)
    apart, ratios, of_both = _beside_stone_soup(range(24))
    _say("same model", apart, ratios, of_both)
    _expect_the_same(apart, ratios)
    np.testing.assert_allclose(np.exp(np.log(ratios).mean(axis=0)), 1.0, atol=0.2)
    low, high = middle_95(3 * len(of_both)) / len(of_both)
    assert np.all((of_both.mean(axis=0) > low) & (of_both.mean(axis=0) < high)), of_both.mean(axis=0)


def _expect_wider(ratios: Floats, of_both: Floats) -> None:
    assert ratios.min() > 0.7, ratios  # as two filters of the same model differ
    wider = np.exp(np.log(ratios).mean(axis=0))
    assert np.all((wider > 1.1) & (wider < 5.0)), wider
    low, high = middle_95(3 * len(of_both)) / len(of_both)
    own, oracle = of_both.mean(axis=0)
    assert low < oracle < high and own < high, (own, oracle)


def test_a_belief_that_allows_for_rooms_is_wider_than_stone_soups_and_never_narrower() -> None:
    """Where nothing is off but by white noise, which only the oracle knows."""
    _, ratios, of_both = _beside_stone_soup(range(4))
    _expect_wider(ratios, of_both)


@pytest.mark.long
def test_no_belief_is_narrower_than_stone_soups_over_many_worlds() -> None:
    apart, ratios, of_both = _beside_stone_soup(range(60))
    _say("as it flies", apart, ratios, of_both)
    _expect_wider(ratios, of_both)


def _say(which: str, apart: Floats, ratios: Floats, of_both: Floats) -> None:
    """The figures that docs/studies.md has."""
    off, wider = np.sqrt(np.mean(apart**2, axis=0)), np.exp(np.log(ratios).mean(axis=0))
    print(f"\n{which}, {len(ratios)} worlds; along the line of sight, across it, up:")
    print(f"means apart [deviations]: {off.round(2)}, at most {np.abs(apart).max(axis=0).round(2)}")
    print(f"ratio of deviations: {wider.round(2)}, {ratios.min(axis=0).round(2)} to {ratios.max(axis=0).round(2)}")
    print(f"mean NEES, ours and the oracle's: {of_both.mean(axis=0).round(2)}")
