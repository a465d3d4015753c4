"""Bearings from first principles: channels made of distances, and the mistakes that must not pass."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.far_field import FarField
from tests.unit.wsr.scene import DIRECTIONS, WAVELENGTH_M, Array, Complex, circle, far, round_trip, weave
from wsr.aoa import AoaEstimate
from wsr.aperture import make_aperture
from wsr.frames import enu_from_ned
from wsr.geometry import direction, great_circle, wrap_angle

Mistake = Callable[[Array, Complex, float], tuple[Array, Complex, float]]

SOME_DIRECTION = np.array([0.6, 0.64, 0.48])
MISTAKES: dict[str, Mistake] = {
    "conjugate forgotten": lambda p, g, wavelength: (p, g.conj(), wavelength),
    "azimuth mirrored": lambda p, g, wavelength: (p * [1, -1, 1], g, wavelength),
    "NED taken for ENU": lambda p, g, wavelength: (enu_from_ned(p), g, wavelength),
    "one-way phase (factor 2)": lambda p, g, wavelength: (p, g, 2 * wavelength),
    "factor 2 twice": lambda p, g, wavelength: (p, g, wavelength / 2),
    "yaw to North left out by 5 degrees": lambda p, g, wavelength: (
        p @ np.array([[0.9962, 0.0872, 0], [-0.0872, 0.9962, 0], [0, 0, 1]]),
        g,
        wavelength,
    ),
}


def _vector(estimate: AoaEstimate) -> Array:
    return direction(estimate.azimuth_rad, estimate.polar_rad)


def _error_deg(estimate: AoaEstimate, u: Array) -> float:
    return math.degrees(great_circle(_vector(estimate), u))


@pytest.mark.parametrize("neighbour", DIRECTIONS)
def test_26_directions_within_a_degree(neighbour: tuple[int, int, int]) -> None:
    u = np.array(neighbour) / np.linalg.norm(neighbour)
    t, p = weave()
    estimate, profile = FarField().estimate(make_aperture(t, p, round_trip(p, far(p, u), 0.5), WAVELENGTH_M))
    assert _error_deg(estimate, u) < 1.0
    assert profile.power.shape == (180, 360)
    assert estimate.coherence == pytest.approx(math.exp(-0.125), abs=0.05)
    assert estimate.polar_observable
    assert estimate.azimuth_observable == (neighbour[:2] != (0, 0))


@pytest.mark.parametrize("name", MISTAKES)
def test_each_classic_mistake_misses_or_defocuses(name: str) -> None:
    """The test above would catch it: with the mistake the bearing is off, or the peak is gone."""
    t, p = weave()
    position, channel, wavelength = MISTAKES[name](p, round_trip(p, far(p, SOME_DIRECTION)), WAVELENGTH_M)
    estimate, _ = FarField().estimate(make_aperture(t, position, channel, wavelength))
    assert _error_deg(estimate, SOME_DIRECTION) > 4.0


def test_forgotten_conjugate_points_to_the_antipode() -> None:
    t, p = weave()
    channel = round_trip(p, far(p, SOME_DIRECTION)).conj()
    estimate, _ = FarField().estimate(make_aperture(t, p, channel, WAVELENGTH_M))
    assert _error_deg(estimate, -SOME_DIRECTION) < 0.1


def test_moving_ends_use_the_relative_displacement() -> None:
    t, p_i = weave()
    p_j = far(p_i, SOME_DIRECTION) + np.stack([0.3 * t, -0.2 * t**2, 0.1 * np.sin(4 * t)], axis=-1)
    channel = round_trip(p_i, p_j, 0.3)
    reported_j = p_j - [100.0, 200.0, 300.0]  # the other end has an origin of its own
    estimate, _ = FarField().estimate(make_aperture(t, p_i, channel, WAVELENGTH_M, p_j_m=reported_j))
    # The truth is between the mean positions, which the reference point stands for.
    assert _error_deg(estimate, SOME_DIRECTION) < 0.1
    blind, _ = FarField().estimate(make_aperture(t, p_i, channel, WAVELENGTH_M))
    assert _error_deg(blind, SOME_DIRECTION) > 5.0 or blind.coherence < 0.5


def test_estimate_names_its_reference_point() -> None:
    t, p = weave()
    estimate, _ = FarField().estimate(make_aperture(t, p, round_trip(p, far(p, SOME_DIRECTION)), WAVELENGTH_M))
    np.testing.assert_allclose(estimate.reference_p_m, p.mean(axis=0))
    assert estimate.reference_t_s == pytest.approx(1.5)
    assert estimate.packets == 600


def test_horizontal_plane_reports_the_upper_image_and_lists_the_lower() -> None:
    t, p = circle()
    for polar_deg in (60.0, 120.0):
        u = direction(math.radians(-110), math.radians(polar_deg))
        estimate, _ = FarField().estimate(make_aperture(t, p, round_trip(p, far(p, u), 0.3), WAVELENGTH_M))
        assert math.degrees(estimate.azimuth_rad) == pytest.approx(-110, abs=0.5)
        assert math.degrees(estimate.polar_rad) == pytest.approx(60, abs=0.5)
        mirror = estimate.alternatives[0]
        assert math.degrees(mirror.azimuth_rad) == pytest.approx(-110, abs=0.5)
        assert math.degrees(mirror.polar_rad) == pytest.approx(120, abs=0.5)
        assert mirror.relative_power == pytest.approx(1.0, abs=1e-3)
        assert estimate.azimuth_observable
        assert not estimate.polar_observable
        assert estimate.reliability > 0.5  # the image is no rival


def test_horizontal_plane_and_a_source_in_it() -> None:
    t, p = circle()
    estimate, _ = FarField().estimate(
        make_aperture(t, p, round_trip(p, far(p, direction(2.5, math.pi / 2)), 0.3), WAVELENGTH_M)
    )
    assert estimate.azimuth_rad == pytest.approx(2.5, abs=0.01)
    assert estimate.azimuth_observable
    assert not estimate.polar_observable


def test_vertical_plane_leaves_two_azimuths() -> None:
    t, p = circle()
    upright = p[:, [0, 2, 1]]  # east and up
    u = direction(math.radians(50), math.radians(70))
    estimate, _ = FarField().estimate(
        make_aperture(t, upright, round_trip(upright, far(upright, u), 0.3), WAVELENGTH_M)
    )
    azimuths = sorted(math.degrees(a) for a in (estimate.azimuth_rad, estimate.alternatives[0].azimuth_rad))
    assert azimuths == pytest.approx([-50, 50], abs=0.5)
    assert not estimate.azimuth_observable
    assert estimate.polar_observable


def test_straight_line_claims_nothing() -> None:
    t = np.linspace(0, 3, 300)
    p = t[:, None] * np.array([0.4, 0.2, 0.0])
    u = direction(1.2, 1.3)
    estimate, _ = FarField().estimate(make_aperture(t, p, round_trip(p, far(p, u), 0.2), WAVELENGTH_M))
    assert not estimate.azimuth_observable
    assert not estimate.polar_observable
    assert estimate.crb_rad == math.inf
    along = p[-1] / np.linalg.norm(p[-1])
    assert math.acos(_vector(estimate) @ along) == pytest.approx(math.acos(u @ along), abs=0.02)  # on the right cone


def test_a_burst_of_strong_wild_packets_does_not_win() -> None:
    t, p = weave()
    rng = np.random.default_rng(3)
    channel = round_trip(p, far(p, SOME_DIRECTION), 0.3)
    burst = rng.choice(600, 60, replace=False)
    channel[burst] = 50 * np.abs(channel[burst]) * np.exp(1j * rng.uniform(-3, 3, 60))
    estimate, _ = FarField().estimate(make_aperture(t, p, channel, WAVELENGTH_M))
    assert _error_deg(estimate, SOME_DIRECTION) < 0.5


@pytest.mark.long
def test_errors_are_as_large_as_the_estimate_says() -> None:
    """Seeded Monte Carlo: normalised squared errors average 1, within what 100 runs can tell."""
    t, p = weave(200)
    source = far(p, SOME_DIRECTION)
    azimuth, polar = math.atan2(0.64, 0.6), math.acos(0.48)
    squares = []
    for seed in range(100):
        aperture = make_aperture(t, p, round_trip(p, source, 0.5, seed), WAVELENGTH_M)
        estimate, _ = FarField(alternatives=0).estimate(aperture)
        error = np.array([wrap_angle(estimate.azimuth_rad - azimuth), estimate.polar_rad - polar])
        squares.append(error @ np.linalg.solve(np.array(estimate.covariance)[:2, :2], error) / 2)
    # The factor for correlated noise is at least 1 and scatters, so the errors look a little small.
    assert 0.5 < float(np.mean(squares)) < 1.3


def test_slow_phase_errors_widen_the_deviation_but_not_the_bound() -> None:
    t, p = weave()
    channel = round_trip(p, far(p, SOME_DIRECTION), 0.2)
    clean, _ = FarField().estimate(make_aperture(t, p, channel, WAVELENGTH_M))
    drifting, _ = FarField().estimate(make_aperture(t, p, channel * np.exp(0.6j * np.sin(9 * t)), WAVELENGTH_M))
    assert drifting.azimuth_std_rad > 3 * clean.azimuth_std_rad
    assert drifting.azimuth_std_rad > 2 * drifting.crb_rad


def test_noise_alone_is_not_coherent() -> None:
    t, p = weave()
    rng = np.random.default_rng(4)
    estimate, _ = FarField().estimate(make_aperture(t, p, np.exp(1j * rng.uniform(-3.1416, 3.1416, 600)), WAVELENGTH_M))
    assert estimate.coherence < 0.2
    assert estimate.reliability < 0.1


def test_estimate_is_plain_and_frozen() -> None:
    t, p = weave(100)
    estimate, _ = FarField().estimate(make_aperture(t, p, round_trip(p, far(p, SOME_DIRECTION)), WAVELENGTH_M))
    for field in dataclasses.fields(estimate):
        assert type(getattr(estimate, field.name)) in (float, int, bool, tuple, dict, type(None)), field.name
    with pytest.raises(dataclasses.FrozenInstanceError):
        estimate.azimuth_rad = 0.0  # type: ignore[misc]
