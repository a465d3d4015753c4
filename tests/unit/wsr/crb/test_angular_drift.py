"""The paper's two lemmas on angular drift: what holds of them, and where the elevation half of the first fails."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.refinement import refine_peak
from tests.unit.wsr.scene import WAVELENGTH_M
from wsr.crb.angular_drift import with_angular_drift
from wsr.geometry import direction, great_circle
from wsr.peaks import find_peaks
from wsr.profile import bartlett_profile

Array = NDArray[np.float64]
OFFSET = math.radians(8)
AZIMUTH, POLAR = 0.7, 1.2
S = np.linspace(0.5, 2.6, 600)


def least_amplitude(
    radius_m: float, wavelength_m: float, azimuth_deviation_rad: float, polar_deviation_rad: float
) -> float:
    """What |sum| / M keeps at least when azimuth and polar angle deviate by up to +-delta and +-mu about their means.

    cos(4 pi rho (delta + mu) / lambda), zero from a quarter turn on, for positions up to `radius_m` from the origin
    and the round-trip product. The profile, a power, keeps the square. The paper prints cos((delta + mu) / 2): the
    scale 4 pi rho / lambda is lost, and half of the deviations would be right only if they were from peak to peak.
    """
    turn = 4 * math.pi * radius_m / wavelength_m * (abs(azimuth_deviation_rad) + abs(polar_deviation_rad))
    return math.cos(turn) if turn < math.pi / 2 else 0.0


def _peak(true_m: Array, estimated_m: Array, azimuth: float, polar: float) -> tuple[Array, float]:
    g = np.exp(4j * np.pi / WAVELENGTH_M * true_m @ direction(azimuth, polar))
    found = find_peaks(bartlett_profile(estimated_m, g, WAVELENGTH_M), 1)[0]
    azimuth, polar, power = refine_peak(
        estimated_m, g, WAVELENGTH_M, azimuth_rad=found.azimuth_rad, polar_rad=found.polar_rad
    )
    return direction(azimuth, polar), power


def _amplitude_towards(
    chi_m: Array, estimated_m: Array, wavelength_m: float, *, azimuth_rad: float, polar_rad: float
) -> float:
    """|sum| / M of unit channels of a source at (azimuth, polar angle), steered there with estimated positions."""
    u = direction(azimuth_rad, polar_rad)
    turn = 4 * np.pi / wavelength_m * ((chi_m - estimated_m) @ u)
    return float(np.abs(np.exp(1j * turn).mean()))


def test_drift_keeps_the_distance_and_turns_the_angles() -> None:
    chi = 0.4 * direction(3 * S, S)
    moved = with_angular_drift(chi, 0.1, -0.2)
    np.testing.assert_allclose(moved, 0.4 * direction(3 * S + 0.1, S - 0.2), atol=1e-12)
    assert with_angular_drift(np.zeros((2, 3)), 0.1, 0.1).tolist() == np.zeros((2, 3)).tolist()


@pytest.mark.parametrize("turns", [0.3, 1.0, 3.0])
def test_constant_azimuth_offset_shifts_the_peak_by_itself_on_any_path(turns: float) -> None:
    chi = 0.4 * direction(turns * S, S)
    u, power = _peak(chi, with_angular_drift(chi, OFFSET, 0.0), AZIMUTH, POLAR)
    assert great_circle(u, direction(AZIMUTH + OFFSET, POLAR)) < 1e-6
    assert power == pytest.approx(1.0)


def test_constant_polar_offset_does_so_on_an_arc_in_the_vertical_plane_of_the_source() -> None:
    chi = 0.4 * direction(AZIMUTH, S)
    u, power = _peak(chi, with_angular_drift(chi, 0.0, OFFSET), AZIMUTH, POLAR)
    # Across its plane an arc has its maximum flat, so the climb to it stops early there.
    assert great_circle(u, direction(AZIMUTH, POLAR + OFFSET)) < math.radians(0.3)
    assert power == pytest.approx(1.0)


@pytest.mark.parametrize(("turns", "source_azimuth"), [(3.0, AZIMUTH), (1.0, AZIMUTH), (0.0, AZIMUTH + 1.0)])
def test_constant_polar_offset_is_no_shift_elsewhere(turns: float, source_azimuth: float) -> None:
    """Neither on paths whose azimuth varies, nor on the same arc for a source out of its plane."""
    chi = 0.4 * direction(AZIMUTH + turns * S, S)
    u, power = _peak(chi, with_angular_drift(chi, 0.0, OFFSET), source_azimuth, POLAR)
    misses = great_circle(u, direction(source_azimuth, POLAR + OFFSET)) > math.radians(2)
    assert misses or power < 0.9


def test_bounded_offsets_keep_the_corrected_cosine_and_not_the_printed_one() -> None:
    """Seeded random deviations and the worst case, signs that alternate on a short arc across the source."""
    rng = np.random.default_rng(4)
    radius, delta, mu = 0.3, math.radians(0.4), math.radians(0.3)
    bound = least_amplitude(radius, WAVELENGTH_M, delta, mu)
    printed = math.cos((delta + mu) / 2)
    lowest = 1.0
    for _ in range(50):
        chi = radius * direction(rng.uniform(-3, 3, 400), rng.uniform(0.2, 2.9, 400))
        azimuth, polar = rng.uniform(-3, 3), rng.uniform(0.2, 2.9)
        estimated = with_angular_drift(chi, rng.uniform(-delta, delta, 400), rng.uniform(-mu, mu, 400))
        lowest = min(lowest, _amplitude_towards(chi, estimated, WAVELENGTH_M, azimuth_rad=azimuth, polar_rad=polar))
    assert bound < lowest < printed
    alternating = delta * np.where(np.arange(400) % 2, 1.0, -1.0)
    chi = radius * direction(np.full(400, AZIMUTH + math.pi / 2), math.pi / 2)
    worst = _amplitude_towards(
        chi, with_angular_drift(chi, alternating, 0.0), WAVELENGTH_M, azimuth_rad=AZIMUTH, polar_rad=math.pi / 2
    )
    assert worst == pytest.approx(least_amplitude(radius, WAVELENGTH_M, delta, 0.0), abs=1e-4)
    assert worst < math.cos(4 * math.pi * radius / WAVELENGTH_M * delta / 2) - 0.05  # the half is lost as well
    upright = radius * direction(AZIMUTH, np.full(400, 0.4))
    moved = with_angular_drift(upright, 0.0, mu * np.where(np.arange(400) % 2, 1.0, -1.0))
    worst = _amplitude_towards(upright, moved, WAVELENGTH_M, azimuth_rad=AZIMUTH, polar_rad=0.4 + math.pi / 2)
    assert worst == pytest.approx(least_amplitude(radius, WAVELENGTH_M, 0.0, mu), abs=1e-4)


def test_a_quarter_turn_of_phase_promises_nothing() -> None:
    quarter = WAVELENGTH_M / 8 / 0.5
    assert least_amplitude(0.5, WAVELENGTH_M, 0.99 * quarter, 0.0) == pytest.approx(math.cos(0.99 * math.pi / 2))
    assert least_amplitude(0.5, WAVELENGTH_M, 1.01 * quarter, 0.0) == 0.0
    assert least_amplitude(0.5, WAVELENGTH_M, 0.0, 0.0) == 1.0
