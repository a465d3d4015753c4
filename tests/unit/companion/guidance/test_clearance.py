"""Past other robots: never nearer than the gate allows, and on to where the way leads."""

from __future__ import annotations

import math

import pytest

from companion.core.messages import Vector3
from companion.guidance.clearance import clear_of


@pytest.mark.parametrize("beside_m", [-0.6, -1e-3, 0.0, 0.2, 1.2])
@pytest.mark.parametrize("up_m", [0.0, 0.8])
def test_a_robot_in_the_way_is_passed_at_the_speed_that_was_wished(beside_m: float, up_m: float) -> None:
    p_m, other_m, nearest_m = (0.0, 0.0, 1.5), (4.0, beside_m, 1.5 - up_m), math.inf
    for _ in range(800):
        ahead = math.atan2(-p_m[1], 8.0 - p_m[0])
        wished: Vector3 = (0.5 * math.cos(ahead), 0.5 * math.sin(ahead), 0.0)
        v = clear_of(wished, p_m, [other_m], 1.0)
        assert math.hypot(*v) == pytest.approx(0.5)
        p_m = (p_m[0] + 0.05 * v[0], p_m[1] + 0.05 * v[1], p_m[2])
        nearest_m = min(nearest_m, math.dist(p_m, other_m))
        if math.dist(p_m, (8.0, 0.0, 1.5)) < 0.1:
            break
    else:
        pytest.fail(f"not there, at {p_m}")
    assert nearest_m > 1.2


def test_what_is_far_away_behind_or_beneath_turns_nothing() -> None:
    v: Vector3 = (0.5, 0.1, 0.2)
    assert clear_of(v, (0.0, 0.0, 1.5), [(4.0, 0.0, 1.5), (-1.0, 0.0, 1.5), (0.3, 0.0, 0.0)], 1.0) == v
    assert clear_of(v, (0.0, 0.0, 1.5), [], 1.0) == v


def test_a_robot_that_comes_too_near_is_backed_away_from() -> None:
    vx, _, _ = clear_of((0.5, 0.0, 0.0), (0.0, 0.0, 1.5), [(0.4, 0.0, 1.5)], 1.0)
    assert vx == pytest.approx(-0.5)
