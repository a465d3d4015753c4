"""A robot's own path: known where it was told, doubtful where it was not, another frame after a restart."""

from __future__ import annotations

import numpy as np
import pytest

from companion.core.clock import NS_PER_S
from companion.team.tracks import Track


def at(*t_s: float) -> np.ndarray:
    return np.round(np.array(t_s) * NS_PER_S).astype(np.int64)


def walked(*parts: tuple[float, float, int]) -> Track:
    """Places (t_s, East, boot)."""
    track = Track()
    for t_s, east_m, boot in parts:
        track.add(round(t_s * NS_PER_S), (east_m, 0.0, 0.0), boot)
    return track


def test_between_places_the_way_is_straight_and_known() -> None:
    track = walked(*((0.2 * k, 0.1 * k, 1) for k in range(50)))
    steps = track.steps(at(1.0, 3.1), at(3.0, 1.1))
    np.testing.assert_allclose(steps.moved_m[:, 0], [1.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(steps.length_m, 1.0, atol=1e-9)
    assert steps.unknown_m.tolist() == [0.0, 0.0]
    assert track.knows(at(1.0, 10.5, 11.5)).tolist() == [True, True, False]


def test_a_way_there_and_back_is_as_long_as_it_was() -> None:
    track = walked(*((0.2 * k, min(0.1 * k, 2.0 - 0.1 * k), 1) for k in range(21)))
    steps = track.steps(at(0.0), at(4.0))
    assert steps.moved_m[0, 0] == pytest.approx(0.0)
    assert steps.length_m[0] == pytest.approx(2.0)


def test_where_nothing_was_heard_a_robot_may_have_gone_anywhere_near() -> None:
    track = walked((0.0, 0.0, 1), (1.0, 0.5, 1), (9.0, 3.0, 1))
    steps = track.steps(at(1.0, 1.0, 9.0), at(9.0, 5.0, 12.0))
    np.testing.assert_allclose(steps.unknown_m, [0.0, 4.0, 3.0])
    assert steps.moved_m[0, 0] == pytest.approx(2.5)
    assert Track().steps(at(0.0), at(2.0)).unknown_m.tolist() == [2.0]
    assert not Track().knows(at(0.0)).any()


def test_after_a_restart_its_frame_is_another_one() -> None:
    big = (1 << 40) + 5
    track = walked((0.0, 0.0, big - 1), (1.0, 0.5, big - 1), (2.0, 90.0, big), (3.0, 90.5, big))
    steps = track.steps(at(0.0, 2.0, 1.4), at(2.0, 3.0, 1.6))
    assert steps.is_new_frame.tolist() == [True, False, True]
    assert steps.moved_m[:, 0].tolist() == [0.0, 0.5, 0.0]
    assert steps.unknown_m[0] == 20.0


def test_after_a_jump_of_its_poses_its_frame_is_another_one() -> None:
    """Else a tracker that found itself again three metres off would have gone there, for sure to a tenth of a metre."""
    track = walked((0.0, 0.0, 1), (0.2, 0.1, 1), (0.4, 3.1, 1), (0.6, 3.2, 1), (5.0, 20.0, 1))
    steps = track.steps(at(0.0, 0.0, 0.4, 0.6), at(0.2, 0.6, 0.6, 5.0))
    assert steps.is_new_frame.tolist() == [False, True, False, False]
    np.testing.assert_allclose(steps.moved_m[:, 0], [0.1, 0.0, 0.1, 16.8])
    assert steps.unknown_m[1] == 20.0


def test_old_places_go_and_the_last_before_stays() -> None:
    track = walked(*((0.2 * k, 0.1 * k, 1) for k in range(50)))
    track.forget_before(round(4.1 * NS_PER_S))
    assert track.steps(at(4.1), at(5.1)).moved_m[0, 0] == pytest.approx(0.5)
    assert not track.knows(at(1.0)).any()
    assert track.newest_ns == round(9.8 * NS_PER_S)
