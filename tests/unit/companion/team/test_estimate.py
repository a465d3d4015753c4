"""The team's places and axes: right and honest while all move, corrected by the others, never told a thing twice."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.core.clock import NS_PER_S
from companion.sim.team import TeamWorld
from companion.study.team import TeamRow, band, reports
from companion.team.estimate import Team
from companion.team.records import RawSighting

BASE_NS = 1_000 * NS_PER_S
SEEN = RawSighting(
    observer=1, target=2, number=1, t_ns=BASE_NS, azimuth_rad=0.3, azimuth_std_rad=0.03, polar_rad=1.5,
    polar_std_rad=0.1, range_m=None, range_std_m=math.inf, reliability=0.8, fresh=1.0, boot=1,
)  # fmt: skip


def standing(team: Team, seconds: float, sightings: list[RawSighting]) -> None:
    for robot in (1, 2, 3):
        for step in range(round(seconds * 5)):
            team.add_place(robot, BASE_NS + step * NS_PER_S // 5, (0.0, 0.0, 0.0), 1)
    for sighting in sightings:
        team.add_sighting(sighting)


def trials(robots: int, count: int, **how: bool) -> list[TeamRow]:
    """Short ones, each with a seed of its own."""
    world = TeamWorld(robots=robots, duration_s=50.0)
    return [
        TeamRow("", robots, list(reports(world, np.random.default_rng([robots, seed]), **how))) for seed in range(count)
    ]


def nees(rows: list[TeamRow]) -> float:
    """For each degree of freedom."""
    late = [one for row in rows for one in row.reports if one.t_s >= 10.0]
    return sum(one.nees for one in late) / sum(one.degrees for one in late)


@pytest.mark.parametrize(("robots", "count"), [(3, 3), pytest.param(5, 2, marks=pytest.mark.long)])
def test_while_all_move_the_errors_are_what_the_covariance_says(robots: int, count: int) -> None:
    """NEES in its 95 % band, but for what few trials leave to chance; docs/results/team.md has many."""
    rows = trials(robots, count)
    assert band(rows).share >= 0.8
    assert 0.7 < nees(rows) < 1.3
    late = [one for row in rows for one in row.reports if one.t_s >= 20.0]
    assert np.mean([one.placed for one in late]) >= 0.9 * (robots - 1)
    assert np.median([one.place_error_m for one in late if one.place_error_m is not None]) < 0.8


@pytest.mark.long
def test_overlapping_apertures_counted_whole_would_claim_too_much() -> None:
    assert nees(trials(3, 2, counts_overlaps=True)) > 1.4 * nees(trials(3, 2))


@pytest.mark.long
def test_axes_that_drift_show_and_are_corrected_by_the_others() -> None:
    """Twenty degrees in a minute, of one of five: by its own poses alone nobody would know."""
    world = TeamWorld(robots=5, duration_s=90.0, turning_rad_s=math.radians(20.0) / 60.0, turning_from_s=15.0)
    *_, last = reports(world, np.random.default_rng(1))
    assert last.turned_deg > 14.0
    assert abs(last.turned_error_deg) < last.turned_deg / 3


def test_a_robot_that_nobody_sees_is_not_placed() -> None:
    *_, last = reports(replace(TeamWorld(duration_s=20.0), observers=frozenset()), np.random.default_rng(1))
    assert last.placed == 0


def test_a_bearing_that_comes_again_changes_nothing() -> None:
    """Repeated, in another order, from a capture: the same bytes, or one more time its own word, count once."""
    first = [SEEN._replace(number=n, t_ns=BASE_NS + n * NS_PER_S) for n in range(6)]
    once, often = Team(1, (2, 3)), Team(1, (2, 3))
    standing(once, 8.0, first)
    standing(often, 8.0, [*reversed(first), *first, *first])
    now_ns = BASE_NS + 7 * NS_PER_S
    a, b = once.update(now_ns), often.update(now_ns)
    assert a is not None and b is not None
    assert a.sightings == b.sightings == 6
    for ours, theirs in zip(a.members, b.members, strict=True):
        np.testing.assert_allclose(ours.covariance_m2, theirs.covariance_m2, rtol=2e-3, atol=1e-6)
        np.testing.assert_allclose(ours.p_own_m, theirs.p_own_m, atol=1e-2)


def test_a_number_that_has_come_round_is_another_bearing() -> None:
    """After 65536 of them, nine hours: else nothing more would be taken of a robot that stays on."""
    team = Team(1, (2, 3))
    standing(team, 4.0, [SEEN])
    for seconds in (3, 50, 80):
        team.update(BASE_NS + seconds * NS_PER_S)
    assert team.add_sighting(SEEN._replace(t_ns=BASE_NS + 80 * NS_PER_S))


def test_bearings_of_strangers_of_oneself_and_without_news_are_not_taken() -> None:
    team = Team(1, (2, 3))
    assert team.add_sighting(SEEN)
    assert not team.add_sighting(SEEN)
    assert team.add_sighting(SEEN._replace(boot=2))  # another boot numbers anew
    for bad in (
        SEEN._replace(number=2, target=9),
        SEEN._replace(number=2, target=1),
        SEEN._replace(number=2, fresh=0.0),
    ):
        assert not team.add_sighting(bad)


def test_before_our_own_first_place_there_is_no_team() -> None:
    assert Team(1, (2,)).update(BASE_NS) is None


def test_after_a_long_silence_it_begins_anew() -> None:
    team = Team(1, (2, 3))
    standing(team, 4.0, [SEEN])
    assert team.update(BASE_NS + 3 * NS_PER_S) is not None
    late_ns = BASE_NS + 600 * NS_PER_S
    team.add_place(1, late_ns, (5.0, 0.0, 0.0), 1)
    state = team.update(late_ns)
    assert state is not None and state.sightings == 0
    assert not any(member.placed for member in state.members)


def test_where_a_robot_stands_that_sees_and_is_seen() -> None:
    """4 m East of us with axes 10 degrees off, and we pass by it."""
    team, heading = Team(1, (2,)), math.radians(10.0)
    for step in range(150):
        t_ns, north_m = BASE_NS + step * NS_PER_S // 5, 0.06 * step - 4.5
        team.add_place(1, t_ns, (0.0, north_m, 0.0), 1)
        team.add_place(2, t_ns, (70.0, -3.0, 8.0), 1)
        towards = math.atan2(-north_m, 4.0)
        if step % 5 == 0:
            seen = SEEN._replace(number=step, t_ns=t_ns, azimuth_rad=towards, polar_rad=math.pi / 2)
            team.add_sighting(seen)
            back = math.remainder(towards + math.pi - heading, math.tau)
            team.add_sighting(seen._replace(observer=2, target=1, azimuth_rad=back))
    state = None
    for second in range(1, 30):
        state = team.update(BASE_NS + second * NS_PER_S)
    assert state is not None
    (member,) = state.members
    assert member.placed
    assert member.p_own_m == pytest.approx((4.0, 4.5 - 0.06 * 145, 0.0), abs=0.7)
    assert math.degrees(member.heading_rad) == pytest.approx(10.0, abs=3.0)
