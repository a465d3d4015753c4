"""Turnaround jitter in exchanges whose carrier offset and clocks are known."""

from __future__ import annotations

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, exchange, weave
from wsr.reciprocity import fold
from wsr.turnaround import carrier_offset_hz, jitter_s

SOURCE = np.array([[9.0, 4.0, 1.5]])


@pytest.mark.parametrize("offset_hz", [-31e3, 8e3, 40e3])
def test_offset_and_jitter_are_found_with_their_signs(offset_hz: float) -> None:
    t, p = weave(900)
    rng = np.random.default_rng(1)
    late_s = 300e-6 + 5e-6 * rng.normal(size=900)
    forward, reverse = exchange(p, SOURCE, offset_hz=offset_hz, t_s=t, turnaround_s=late_s)
    # The other end's clock runs faster by the ratio of the carriers.
    stamped_s = late_s + offset_hz * WAVELENGTH_M / 299_792_458.0 * t
    centre = fold(forward, reverse).centre
    found = carrier_offset_hz(centre, stamped_s, t, WAVELENGTH_M)
    assert found == pytest.approx(offset_hz, abs=500)
    late = jitter_s(stamped_s, t, found, WAVELENGTH_M)
    np.testing.assert_allclose(late, late_s - np.median(late_s), atol=1e-7)

    still = fold(*exchange(p, SOURCE)).centre
    before, after = centre * still.conj(), centre * np.exp(2j * np.pi * found * late) * still.conj()
    steadiness = [float(np.abs(np.mean(z / np.abs(z)))) for z in (before, after)]
    assert steadiness[1] > 0.98
    if abs(offset_hz) > 10e3:
        assert steadiness[0] < 0.8


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("offset_hz", [-31e3, 8e3])
def test_where_products_do_not_tell_the_clocks_do(offset_hz: float, seed: int) -> None:
    """Thirty packets, 0.9 wavelengths from one to the next: neighbouring products have nothing in common."""
    t, p = weave(900)
    t, p = t[::30], p[::30] * (0.05 / np.linalg.norm(np.diff(p[::30], axis=0), axis=1).mean())
    rng = np.random.default_rng(seed)
    late_s = 300e-6 + 5e-6 * rng.normal(size=30)
    forward, reverse = exchange(p, SOURCE, offset_hz=offset_hz, t_s=t, turnaround_s=late_s)
    stamped_s = np.floor(1e6 * (late_s + offset_hz * WAVELENGTH_M / 299_792_458.0 * t)) * 1e-6
    found = carrier_offset_hz(fold(forward, reverse).centre, stamped_s, t, WAVELENGTH_M)
    # The clocks alone: 5 us over 30 stamps and 3 s or more is 1 ppm, 6 kHz.
    assert found == pytest.approx(offset_hz, abs=15e3)


def test_without_jitter_there_is_no_offset_to_find() -> None:
    t, p = weave(900)
    centre = fold(*exchange(p, SOURCE, noise=0.02)).centre
    assert carrier_offset_hz(centre, np.full(900, 3e-4), t, WAVELENGTH_M) == 0.0


def test_few_packets_have_no_offset() -> None:
    assert carrier_offset_hz(np.ones(10, complex), np.zeros(10), np.arange(10.0), WAVELENGTH_M) == 0.0
