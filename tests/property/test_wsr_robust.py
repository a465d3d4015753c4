"""What must not matter to the robust estimate, what must turn it, and what it must refuse."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.unit.wsr.scene import WAVELENGTH_M, Array, CsiRows, exchange, weave
from wsr.aoa import AoaEstimate
from wsr.aperture import make_aperture
from wsr.errors import ApertureError
from wsr.estimators.robust import Robust
from wsr.geometry import direction, great_circle

few = settings(max_examples=8, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
azimuths, polars = st.floats(-3.1, 3.1), st.floats(0.5, 2.6)
T_S, P_M = weave(500)
LIMIT_RAD = math.radians(0.3)


def _estimate(
    p: Array, csi: tuple[CsiRows, CsiRows], wavelength_m: float = WAVELENGTH_M, **other: Array
) -> AoaEstimate:
    forward, reverse = csi
    product = (forward * reverse).mean(axis=1)
    aperture = make_aperture(T_S, p, product, wavelength_m, forward=forward, reverse=reverse, **other)  # type: ignore[arg-type]
    return Robust().estimate(aperture)[0]


def _apart_rad(estimate: AoaEstimate, u: Array) -> float:
    return float(great_circle(direction(estimate.azimuth_rad, estimate.polar_rad), u))


@given(azimuths, polars, st.lists(st.floats(-3, 3), min_size=3, max_size=3))
@few
def test_turns_with_the_scene(azimuth: float, polar: float, turn_rad: list[float]) -> None:
    source = P_M.mean(axis=0) + 6 * direction(azimuth, polar)
    csi = exchange(P_M, source[None, :])
    here = _estimate(P_M, csi)
    turn = Rotation.from_rotvec(turn_rad)
    turned = _estimate(turn.apply(P_M), csi)
    u = turn.apply(direction(here.azimuth_rad, here.polar_rad))
    assert _apart_rad(turned, u) < LIMIT_RAD
    assert _apart_rad(here, direction(azimuth, polar)) < 2 * LIMIT_RAD


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-9.0, 9.0), st.floats(-500, 500))
@few
def test_phase_gain_units_and_place_do_not_matter(ahead: float, back: float, decades: float, place: float) -> None:
    """Positions are metres; the channel comes in whatever units the receiver counts in."""
    u = direction(0.7, 1.3)
    forward, reverse = exchange(P_M, (P_M.mean(axis=0) + 6 * u)[None, :])
    turned = (
        (10.0**decades * np.exp(1j * ahead) * forward).astype(np.complex64),
        (0.2 * np.exp(1j * back) * reverse).astype(np.complex64),
    )
    here = _estimate(P_M, (forward, reverse))
    moved = _estimate(P_M + place, turned)
    assert _apart_rad(moved, direction(here.azimuth_rad, here.polar_rad)) < LIMIT_RAD
    both = _estimate(P_M + place, turned, p_j_m=np.full_like(P_M, place))
    assert _apart_rad(both, direction(here.azimuth_rad, here.polar_rad)) < LIMIT_RAD


@given(azimuths, polars)
@few
def test_seen_from_the_other_end_the_bearing_is_opposite(azimuth: float, polar: float) -> None:
    other = P_M.mean(axis=0) + 8 * direction(azimuth, polar)
    forward, reverse = exchange(P_M, other[None, :])
    still = np.broadcast_to(other, P_M.shape)
    here = _estimate(P_M, (forward, reverse))
    there = _estimate(still, (reverse, forward), p_j_m=P_M)
    assert _apart_rad(there, -direction(here.azimuth_rad, here.polar_rad)) < LIMIT_RAD
    np.testing.assert_allclose(there.reference_p_m, other, atol=0.2)


def test_refusals_say_what_and_by_how_much() -> None:
    csi = exchange(P_M, np.array([[9.0, 4.0, 1.5]]))
    wild = P_M.copy()
    wild[7, 1] = np.nan
    with pytest.raises(ApertureError, match=r"p_i_m is not finite in 1 packets"):
        _estimate(wild, csi)
    with pytest.raises(ApertureError, match=r"spans 0\.\d+ m; needs at least 0\.108 m"):
        _estimate(0.1 * (P_M - P_M.mean(axis=0)), csi)
    with pytest.raises(ApertureError, match=r"spans 0\.000 m"):
        _estimate(np.ones_like(P_M), csi)
    with pytest.raises(ApertureError, match=r"4 different places; needs at least 20"):
        _estimate(np.repeat(P_M[::125], 125, axis=0), csi)
    with pytest.raises(ApertureError, match=r"has 19 packets; needs at least 20"):
        make_aperture(T_S[:19], P_M[:19], np.ones(19), WAVELENGTH_M)
    forward, reverse = csi
    scrambled = reverse[:, np.random.default_rng(1).permutation(30)]
    with pytest.raises(ApertureError, match=r"of 500 packets are consistent"):
        _estimate(
            P_M, (forward, scrambled * np.random.default_rng(2).choice([-1, 1], scrambled.shape).astype(np.complex64))
        )
