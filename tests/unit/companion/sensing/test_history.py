"""The bounded history keeps the newest rows in order and gives both neighbours of a time."""

from __future__ import annotations

import numpy as np

from companion.sensing.history import History


def test_slices_include_a_row_on_either_side() -> None:
    history = History(100, 1)
    for t in range(0, 100, 10):
        assert history.append(t, [t])
    times, rows = history.between(25, 41)
    np.testing.assert_array_equal(times, [20, 30, 40, 50])
    np.testing.assert_array_equal(rows[:, 0], times)
    assert len(history.between(200, 300)[0]) == 1
    assert len(History(4, 1).between(0, 1)[0]) == 0


def test_the_oldest_rows_go_first_however_long_it_runs() -> None:
    history = History(8, 2)
    for t in range(100):
        history.append(t, [t, -t])
        times, rows = history.between(-1, 1000)
        np.testing.assert_array_equal(times, np.arange(max(0, t - 7), t + 1))
        np.testing.assert_array_equal(rows[:, 1], -times)
    assert history.newest_ns == 99


def test_time_does_not_go_back() -> None:
    history = History(8, 1)
    history.append(5, [0])
    assert not history.append(4, [0])
    assert history.append(5, [1])
    assert history.refused == 1


def test_rows_that_are_not_asked_for_are_kept_all_the_same() -> None:
    """They are gathered first; a capacity that holds no gathering is one of its own."""
    for capacity in (3, 128, 200):
        history = History(capacity, 1)
        for t in range(1000):
            history.append(t, (2 * t,))
            assert history.newest_ns == t
        times, rows = history.between(0, 1000)
        np.testing.assert_array_equal(times, np.arange(1000 - capacity, 1000))
        np.testing.assert_array_equal(rows[:, 0], 2 * times)
