"""The commanded motion: whatever is wished, position, velocity and acceleration agree and keep within their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.core.messages import Vector3
from companion.guidance.motion import Motion

_TICK_S = 0.05
_MOST_JERK_M_S3 = 8.0


def flown(wishes: list[Vector3], most_m_s2: float = 2.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places, velocities and accelerations (T, 3) at the ticks."""
    motion = Motion(most_m_s2)
    motion.start((1.0, 2.0, 3.0))
    rows = [(motion.p_m, motion.v_m_s, motion._a_m_s2)]
    for wished in wishes:
        motion.step(wished, _TICK_S)
        rows.append((motion.p_m, motion.v_m_s, motion._a_m_s2))
    p, v, a = (np.array([row[n] for row in rows]) for n in range(3))
    return p, v, a


@given(st.lists(st.tuples(*[st.floats(-5.0, 5.0)] * 3), min_size=1, max_size=40))
def test_no_wish_makes_a_step(wishes: list[Vector3]) -> None:
    p, v, a = flown(wishes)
    assert np.linalg.norm(a, axis=1).max() <= 2.0 + 1e-9
    assert np.linalg.norm(np.diff(a, axis=0), axis=1).max() <= _MOST_JERK_M_S3 * _TICK_S + 1e-9
    assert np.linalg.norm(np.diff(v, axis=0), axis=1).max() <= 2.0 * _TICK_S + 1e-9
    # Each tick's way lies between what its first and its last velocity would make of it.
    assert np.abs(np.diff(p, axis=0) - 0.5 * _TICK_S * (v[1:] + v[:-1])).max() <= 2.0 * _TICK_S**2


def test_a_wish_is_met_after_a_second_without_shooting_over() -> None:
    _, v, _ = flown([(0.4, 0.0, 0.0)] * 40)
    assert v[20, 0] == pytest.approx(0.4, rel=0.05)
    assert v[:, 0].max() <= 0.4 * 1.001
    assert (np.diff(v[:, 0]) >= -1e-9).all()


def test_a_late_tick_makes_no_leap() -> None:
    motion, late = Motion(2.0), Motion(2.0)
    motion.step((1.0, 0.0, 0.0), 0.1)
    late.step((1.0, 0.0, 0.0), 3.0)
    assert late.p_m == motion.p_m and late.v_m_s == motion.v_m_s


def test_it_starts_as_the_vehicle_is_and_moves_with_its_frame() -> None:
    motion = Motion(2.0)
    motion.start((1.0, 0.0, 1.5), (0.3, 0.0, 0.0))
    motion.step((0.3, 0.0, 0.0), _TICK_S)
    assert motion.v_m_s == pytest.approx((0.3, 0.0, 0.0))
    before = motion.p_m
    motion.shift((0.0, -2.0, 0.5))
    assert math.dist(motion.p_m, before) == pytest.approx(math.hypot(2.0, 0.5))
    assert motion.v_m_s == pytest.approx((0.3, 0.0, 0.0))
