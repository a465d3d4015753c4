"""The grid of directions."""

from __future__ import annotations

import numpy as np

from wsr.directions import AZIMUTH_RAD, POLAR_RAD


def test_grid_is_one_degree_and_off_the_poles() -> None:
    np.testing.assert_allclose(np.rad2deg(AZIMUTH_RAD), np.arange(-180, 180), atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(POLAR_RAD), np.arange(180) + 0.5)
