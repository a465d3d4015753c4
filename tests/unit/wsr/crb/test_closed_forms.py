"""The closed forms of the bound."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from tests.unit.wsr.crb import closed_forms
from tests.unit.wsr.scene import WAVELENGTH_M
from wsr.crb import Phase, fim
from wsr.geometry import direction

_GRID = np.meshgrid(np.arange(-170, 180, 31), np.arange(3, 180, 28))
AZIMUTH, POLAR = (np.radians(a.ravel()) for a in _GRID)
TAU = np.linspace(0.0, 2 * np.pi, 4096, endpoint=False)
PHASES: tuple[Phase, Phase] = ("known", "unknown")


@pytest.mark.parametrize("phase", PHASES)
def test_closed_forms_are_means_over_the_path(phase: Phase) -> None:
    radius, directions = 0.35, list(zip(AZIMUTH.tolist(), POLAR.tolist(), strict=True))
    helix_m, circle_m = radius * direction(TAU, TAU), radius * direction(TAU, np.pi / 2)
    along, length = direction(0.4, 1.0), 2.0
    line_m = length * (np.arange(4096)[:, None] + 0.5) / 4096 * along
    for chi, closed in (
        (helix_m, closed_forms.helix(radius, WAVELENGTH_M, AZIMUTH, POLAR, phase)),
        (circle_m, closed_forms.circle(radius, WAVELENGTH_M, AZIMUTH, POLAR)),
        (line_m, closed_forms.line(length, along, WAVELENGTH_M, AZIMUTH, POLAR, phase)),
    ):
        mean = np.array([fim(chi, WAVELENGTH_M, p, t, 1.0, phase, round_trip=False) for p, t in directions]) / len(chi)
        size = float(np.abs(mean).max())
        np.testing.assert_allclose(closed.a, mean[:, 1, 1], rtol=1e-6, atol=1e-9 * size)
        np.testing.assert_allclose(closed.b, mean[:, 0, 0], rtol=1e-6, atol=1e-9 * size)
        np.testing.assert_allclose(closed.c, mean[:, 0, 1], rtol=1e-6, atol=1e-9 * size)
    one_way = closed_forms.helix(radius, WAVELENGTH_M, AZIMUTH, POLAR, phase)
    product = closed_forms.helix(radius, WAVELENGTH_M, AZIMUTH, POLAR, phase, round_trip=True)
    np.testing.assert_allclose(_determinant(product), 16 * _determinant(one_way))
    determinant = _determinant(closed_forms.line(length, along, WAVELENGTH_M, AZIMUTH, POLAR))
    assert np.abs(determinant).max() < 1e-9 * size**2


def _determinant(of: closed_forms.MeanInformation) -> npt.NDArray[np.float64]:
    return np.asarray(of.a * of.b - of.c**2)
