"""Legs: as long as asked, within the limits, towards the target, and never flat."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.study.leg import LegShape, plan_leg

SHAPE = LegShape(length_m=1.2, lateral_m=0.12, vertical_m=0.1, speed_m_s=0.5, acceleration_m_s2=0.8)


@pytest.mark.parametrize("azimuth_deg", [0, 37, 90, 200, -135])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_leg_keeps_its_promises(azimuth_deg: float, side: int) -> None:
    azimuth_rad = math.radians(azimuth_deg)
    leg = plan_leg((1.0, -2.0, 1.5), azimuth_rad, 1.5, side, shape=SHAPE)
    p, v = leg.p_local_enu_m, leg.v_local_enu_m_s
    np.testing.assert_allclose(p[0], (1.0, -2.0, 1.5), atol=1e-9)
    advance = p[-1] - p[0]
    assert math.atan2(advance[1], advance[0]) == pytest.approx(math.remainder(azimuth_rad, math.tau), abs=1e-6)
    assert np.linalg.norm(np.diff(p, axis=0), axis=1).sum() == pytest.approx(1.2, abs=0.005)
    assert np.linalg.norm(v, axis=1).max() <= 0.5 * 1.001
    assert np.linalg.norm(np.gradient(v, leg.t_s, axis=0), axis=1).max() < 1.5
    spread = np.linalg.svd(p - p.mean(axis=0), compute_uv=False) / math.sqrt(len(p))
    assert spread[2] > 0.04  # metres of standard deviation along the thinnest axis
    assert np.abs(p[:, 2] - 1.5).max() < 0.11


def test_a_leg_returns_to_its_height() -> None:
    leg = plan_leg((0.0, 0.0, 1.2), 0.0, 1.5, 1, shape=SHAPE)
    assert leg.p_local_enu_m[-1, 2] == pytest.approx(1.5)
    assert leg.at(leg.duration_s + 5) == ((*leg.p_local_enu_m[-1],), (0.0, 0.0, 0.0))
