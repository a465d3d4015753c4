"""The last step: to the maximum in float64, and no further than it may go."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, Array, Complex, weave
from wsr.focus import Focus
from wsr.geometry import direction
from wsr.likelihood import matched, most_likely
from wsr.subapertures import SubApertures, sub_apertures

AT = (2.1, 1.2, 4.0)
X_M = weave(200)[1] - weave(200)[1].mean(axis=0)
ONE = np.zeros(200, np.int64)
ALIKE = np.ones(200, np.int64)


def _wave(at: tuple[float, float, float] = AT) -> Complex:
    d = np.linalg.norm(at[2] * direction(at[0], at[1]) - X_M, axis=1) - at[2]
    return np.asarray(np.exp(-2j * np.pi / WAVELENGTH_M * d)[:, None])


def _parts(channel: Complex, segment: Array | None = None) -> SubApertures:
    where = ONE if segment is None else segment.astype(np.int64)
    return sub_apertures(X_M, channel, where, WAVELENGTH_M, scales=(1,))


def test_at_the_source_all_bins_agree() -> None:
    m = matched(_parts(_wave()), X_M, ONE, Focus(*AT, 1.0))
    np.testing.assert_allclose(m, 200.0, rtol=1e-4)


def test_pieces_with_the_other_sign_are_joined() -> None:
    """As a broken chain of signs leaves them: the sum is that of the whole."""
    segment = np.repeat([0, 1, 2], [80, 70, 50])
    signs = np.repeat([1.0, -1.0, 1.0], [80, 70, 50])[:, None]
    m = matched(_parts(signs * _wave(), segment), X_M, segment, Focus(*AT, 1.0))
    np.testing.assert_allclose(m, 200.0, rtol=1e-4)


def test_it_ends_at_the_source() -> None:
    found = most_likely(_parts(_wave()), X_M, ONE, ALIKE, focus=Focus(AT[0] + 0.01, AT[1] - 0.008, 4.6, 0.9))
    assert found.azimuth_rad == pytest.approx(AT[0], abs=1e-6)
    assert found.polar_rad == pytest.approx(AT[1], abs=1e-6)
    assert found.range_m == pytest.approx(AT[2], rel=1e-4)
    assert found.coherence > 0.9


def test_a_phase_of_the_nuisances_form_does_not_move_it() -> None:
    ramp = np.linspace(-1.0, 1.0, 200)
    bent = _wave() * np.exp(0.4j * ramp)[:, None]
    start = Focus(AT[0] + 0.01, AT[1], AT[2], 0.9)
    biased = most_likely(_parts(bent), X_M, ONE, ALIKE, focus=start)
    freed = most_likely(_parts(bent), X_M, ONE, ALIKE, focus=start, nuisance=ramp)
    assert abs(freed.azimuth_rad - AT[0]) < 0.1 * abs(biased.azimuth_rad - AT[0])


@pytest.mark.parametrize("start", [Focus(AT[0] + 0.2, AT[1], 4.0, 0.5), Focus(AT[0] + 2.0, AT[1], None, 0.5)])
def test_what_leads_too_far_or_not_up_stays_as_it_is(start: Focus) -> None:
    assert most_likely(_parts(_wave()), X_M, ONE, ALIKE, focus=start) == start


def test_a_place_where_the_robot_stood_does_not_outweigh_the_path() -> None:
    """Its bin has a thousand packets and a phase that is off by a radian; it counts as four of the usual ones."""
    wave, counts = _wave(), ALIKE.copy()
    wave[0] *= np.exp(1j)
    counts[0] = 1000
    found = most_likely(_parts(wave), X_M, ONE, counts, focus=Focus(*AT, 0.9))
    assert abs(found.azimuth_rad - AT[0]) < math.radians(0.5)
