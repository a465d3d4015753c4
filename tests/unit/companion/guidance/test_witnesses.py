"""What a belief that has moved on would forget: another source, nearer to where the flight began."""

from __future__ import annotations

import numpy as np
import pytest

from companion.guidance.witnesses import Witnesses

ROBOT, IMAGE = np.array([8.0, 0.0, 0.5]), np.array([14.0, 0.0, 0.5])


def _seen_around(witnesses: Witnesses, source_m: np.ndarray, sides: tuple[float, ...]) -> None:
    for angle in sides:
        unit = np.array([np.cos(angle), np.sin(angle), 0.0])
        witnesses.add(source_m + 0.2 * unit, unit, 0.2)


def test_the_robot_is_nearer_than_its_image_and_not_the_other_way_round() -> None:
    witnesses = Witnesses(np.zeros(3))
    _seen_around(witnesses, ROBOT, (0.0, 0.7, 1.4, 2.1))
    _seen_around(witnesses, IMAGE, (0.0, 0.7, 1.4, 2.1))
    nearer = witnesses.nearer(IMAGE)
    assert nearer is not None and nearer == pytest.approx(ROBOT, abs=0.3)
    assert witnesses.nearer(ROBOT) is None


def test_what_was_seen_from_one_side_or_hardly_at_all_does_not_count() -> None:
    feigned = Witnesses(np.zeros(3))
    _seen_around(feigned, ROBOT, (0.0, 0.1, 0.0, 0.1, 0.05))
    assert feigned.nearer(IMAGE) is None
    short = Witnesses(np.zeros(3))
    _seen_around(short, ROBOT, (0.0, 1.5))
    assert short.nearer(IMAGE) is None


def test_a_frame_that_was_set_anew_takes_them_along() -> None:
    witnesses, delta = Witnesses(np.zeros(3)), np.array([100.0, -50.0, 1.0])
    _seen_around(witnesses, ROBOT, (0.0, 0.7, 1.4, 2.1))
    before = witnesses.nearer(IMAGE)
    witnesses.shift(delta)
    after = witnesses.nearer(IMAGE + delta)
    assert before is not None and after is not None
    assert np.subtract(after, before) == pytest.approx(delta)


def test_a_long_flight_keeps_what_was_seen_most() -> None:
    witnesses = Witnesses(np.zeros(3))
    _seen_around(witnesses, ROBOT, (0.0, 0.7, 1.4, 2.1))
    for number in range(500):
        witnesses.add(np.array([3.0 * number, 40.0, 0.5]), np.array([1.0, 0.0, 0.0]), 0.2)
    nearer = witnesses.nearer(IMAGE)
    assert nearer is not None and nearer == pytest.approx(ROBOT, abs=0.3)


def test_what_is_looked_for_from_near_and_not_seen_counts_no_more() -> None:
    """Or a flight would circle for ever around a place that drift has feigned, and say nothing."""
    feigned, robot = Witnesses(np.zeros(3)), Witnesses(np.zeros(3))
    for witnesses in (feigned, robot):
        _seen_around(witnesses, ROBOT, (0.0, 0.7, 1.4, 2.1))
    for number in range(40):  # eight apertures
        beside = ROBOT + 1.4 * np.array([np.cos(number), np.sin(number), 0.0])
        feigned.look(beside, 0.2)
        robot.look(beside, 0.2)
        if number % 3 == 0:  # in a hard room a range shows now and then
            robot.add(ROBOT, np.array([-np.cos(number), -np.sin(number), 0.0]), 0.2)
    assert feigned.nearer(IMAGE) is None
    assert robot.nearer(IMAGE) == pytest.approx(ROBOT, abs=0.3)
    afar = Witnesses(np.zeros(3))
    _seen_around(afar, ROBOT, (0.0, 0.7, 1.4, 2.1))
    for _ in range(40):
        afar.look(np.zeros(3), 0.2)
    assert afar.nearer(IMAGE) is not None
