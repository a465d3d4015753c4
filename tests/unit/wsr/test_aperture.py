"""What an aperture accepts, what it refuses, and what it knows about its shape."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, circle, weave
from wsr.aperture import Aperture, make_aperture
from wsr.errors import ApertureError


def test_geometry_of_a_box_walk() -> None:
    corners = np.array([[0, 0, 0], [3, 0, 0], [3, 2, 0], [3, 2, 1]], float)
    steps = np.linspace(0, 1, 50)[:, None]
    p = np.concatenate([a + steps * (b - a) for a, b in itertools.pairwise(corners)])
    aperture = make_aperture(np.arange(150.0), p + 9, np.ones(150), WAVELENGTH_M)
    assert aperture.length_m == pytest.approx(6.0)
    assert aperture.dimension == 3
    np.testing.assert_allclose(aperture.chi_m.mean(axis=0), 0, atol=1e-12)
    longest, middle, least = aperture.extents_m
    assert longest > middle > least > 0
    assert longest <= np.sqrt(14) + 1e-9


@pytest.mark.parametrize(
    ("radius_m", "lift_m", "dimension"),
    [(0.3, 0.0, 2), (0.3, 0.012, 2), (0.3, 0.016, 3), (2.0, 0.05, 2), (2.0, 0.07, 3)],
)
def test_dimension_counts_half_wavelengths_and_three_percent(radius_m: float, lift_m: float, dimension: int) -> None:
    t, p = circle(radius_m=radius_m)
    p[:, 2] = lift_m * np.sin(2 * np.pi * t)
    assert make_aperture(t, p, np.ones(600), WAVELENGTH_M).dimension == dimension


def test_dimension_of_a_line_in_any_direction() -> None:
    t = np.linspace(0, 1, 100)
    assert make_aperture(t, t[:, None] * [1, 2, 2], np.ones(100), WAVELENGTH_M).dimension == 1


def test_packets_are_sorted_by_time() -> None:
    t, p = weave(50)
    g = np.exp(1j * np.arange(50))
    shuffled = np.random.default_rng(0).permutation(50)
    a, b = make_aperture(t, p, g, 0.05), make_aperture(t[shuffled], p[shuffled], g[shuffled], 0.05)
    np.testing.assert_array_equal(a.t_s, b.t_s)
    np.testing.assert_allclose(a.chi_m, b.chi_m, atol=1e-12)
    np.testing.assert_array_equal(a.channel, b.channel)


def test_arrays_cannot_be_changed_afterwards() -> None:
    t, p = weave(50)
    aperture = make_aperture(t, p, np.ones(50), 0.05)
    with pytest.raises(ValueError, match="read-only"):
        aperture.chi_m[0] = 0


def test_refusals_name_quantity_and_limit() -> None:
    t, p = weave(50)
    g = np.ones(50, np.complex128)
    broken = p.copy()
    broken[7, 1] = np.nan
    with pytest.raises(ApertureError, match="19 packets; needs at least 20"):
        make_aperture(t[:19], p[:19], g[:19], 0.05)
    with pytest.raises(ApertureError, match="p_i_m is not finite in 1 packets"):
        make_aperture(t, broken, g, 0.05)
    with pytest.raises(ApertureError, match="p_j_m is not finite in 1 packets"):
        make_aperture(t, p, g, 0.05, p_j_m=broken)
    with pytest.raises(ApertureError, match=r"spans 0\.000 m; needs at least 0\.100 m"):
        make_aperture(t, np.ones((50, 3)), g, 0.05)
    with pytest.raises(ApertureError, match=r"chi_m reaches 1\.\d+e\+155 m"):
        make_aperture(t, np.where(np.arange(50)[:, None] == 3, 2e155, p), g, 0.05)
    with pytest.raises(ApertureError, match="channel is zero"):
        make_aperture(t, p, 0 * g, 0.05)
    with pytest.raises(ApertureError, match="channel has 1 values that are not finite"):
        make_aperture(t, p, np.where(np.arange(50) == 3, np.inf, g), 0.05)
    with pytest.raises(ApertureError, match=r"p_i_m has shape \(49, 3\)"):
        make_aperture(t, p[:49], g, 0.05)
    with pytest.raises(ApertureError, match="channel has shape"):
        make_aperture(t, p, g[:49], 0.05)
    with pytest.raises(ApertureError, match="wavelength_m is -1"):
        make_aperture(t, p, g, -1.0, min_length_m=0.0)
    with pytest.raises(ApertureError, match="t_s decreases"):
        Aperture(t_s=t[::-1], chi_m=p, channel=g, wavelength_m=0.05, reference_p_m=(0, 0, 0), reference_t_s=0.0)
    for ours, theirs in ((30, 1), (1, 30), (29, 29), (0, 0)):
        ahead, back = np.ones((50, ours), np.complex64), np.ones((50, theirs), np.complex64)
        with pytest.raises(ApertureError, match=f"forward has {ours} subcarriers and reverse {theirs}; expected 30"):
            make_aperture(t, p, g, 0.05, forward=ahead, reverse=back)
    with pytest.raises(ApertureError, match="0 packets"):
        make_aperture([], np.empty((0, 3)), [], 0.05, min_packets=0)


def test_no_motion_is_enough_when_the_limit_says_so() -> None:
    t, p = weave(50)
    assert make_aperture(t[:10], p[:10], np.ones(10), 0.05, min_packets=5, min_length_m=0.0).packets == 10
