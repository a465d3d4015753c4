"""The team's process from within: all that waits is taken before the next update."""

from __future__ import annotations

from companion.core.clock import NS_PER_S
from companion.team.estimate import Team
from companion.team.news import News
from companion.team.worker import take
from tests.unit.companion.team.test_estimate import BASE_NS, SEEN


def news(second: int) -> News:
    now_ns = BASE_NS + second * NS_PER_S
    return News(now_ns, [(robot, 1, now_ns, (0.0, 0.0, 0.0)) for robot in (1, 2, 3)], [SEEN._replace(number=second)])


def test_who_is_behind_catches_up_with_one_update() -> None:
    state = take(Team(1, (2, 3)), [news(second) for second in range(5)])
    assert state is not None
    assert state.t_mono_ns == BASE_NS + 4 * NS_PER_S and state.sightings == 5
    assert state.solve_s > 0.0


def test_before_our_own_place_there_is_nothing_to_tell() -> None:
    assert take(Team(1, (2,)), [News(BASE_NS, [], [])]) is None
