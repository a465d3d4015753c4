"""Who is placed: not who is sure of himself, but whose bearings agree; and where else one may be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.team.factors import Sightings, look
from companion.team.placing import is_sure, largest_std_m, other_guesses, supported

PAIRS = [(i, j) for i in range(3) for j in range(3) if i != j]


def scene() -> tuple[np.ndarray, Sightings]:
    """Three robots at one keyframe, six bearings of each by each other, all exact."""
    states = np.zeros((1, 3, 4))
    states[0, 1, :3], states[0, 2, :3] = (8.0, 1.0, 0.0), (3.0, 9.0, 1.0)
    observer, target = (np.repeat([pair[side] for pair in PAIRS], 6) for side in (0, 1))
    count = len(observer)
    seen = Sightings(
        keyframe=np.zeros(count, np.intp),
        observer=observer,
        target=target,
        observer_way_m=np.zeros((count, 3)),
        target_way_m=np.zeros((count, 3)),
        measured=np.zeros((count, 3)),
        std=np.tile([0.1, 0.2, np.inf], (count, 1)),
        reliability=np.full(count, 0.6),
        fresh=np.ones(count),
    )
    wide = replace(seen, std=np.ones((count, 3)))
    return states, replace(seen, measured=look(states, wide).residual)


def test_where_all_bearings_agree_everybody_is_supported() -> None:
    states, seen = scene()
    assert supported(states, seen) == [True] * 3


def test_who_agrees_with_nobody_is_not_though_the_others_agree_among_themselves() -> None:
    """Seen from anywhere else than where it is, the rest of the team still looks right."""
    states, seen = scene()
    states[0, 1:, :3] += (-14.0, -13.0, 0.0)
    assert not supported(states, seen)[0]


def test_a_few_bearings_or_none_are_not_enough() -> None:
    states, seen = scene()
    assert supported(states, replace(seen, fresh=np.full(len(seen), 0.2))) == [False] * 3
    nothing = Sightings(**{name: getattr(seen, name)[:0] for name in Sightings.__slots__})
    assert supported(states, nothing) == [False] * 3


def test_sure_is_what_is_known_in_every_direction_for_its_range() -> None:
    assert largest_std_m(np.diag([0.04, 4.0, 0.01])) == 2.0
    assert is_sure(np.array([7.0, 0.0, 0.0]), np.diag([0.04, 4.0, 0.01]))
    assert not is_sure(np.array([6.0, 0.0, 0.0]), np.diag([0.04, 4.0, 0.01]))
    assert is_sure(np.array([0.5, 0.0, 0.0]), np.diag([0.2, 0.2, 0.2]))


def test_other_places_lie_where_bearings_point_and_one_of_them_is_right() -> None:
    states, seen = scene()
    wrong = states.copy()
    wrong[0, 1, :3] = (-5.0, -6.0, 0.0)
    guesses = list(other_guesses(1, wrong, seen))
    assert len(guesses) >= 3
    assert all((guess[:, [0, 2]] == wrong[:, [0, 2]]).all() for guess in guesses)
    assert min(np.linalg.norm(guess[0, 1, :3] - states[0, 1, :3]) for guess in guesses) < 1.5


def test_with_ourselves_the_others_are_moved_together() -> None:
    states, seen = scene()
    wrong = states.copy()
    wrong[0, 1:, :3] += (-14.0, -13.0, 0.0)
    guesses = list(other_guesses(0, wrong, seen))
    assert all((guess[0, 0] == 0.0).all() for guess in guesses)
    for guess in guesses:
        np.testing.assert_allclose(guess[0, 2, :3] - guess[0, 1, :3], states[0, 2, :3] - states[0, 1, :3])
    assert min(np.linalg.norm(guess[0, 1, :3] - states[0, 1, :3]) for guess in guesses) < 2.5
