"""The band of a chi-square distribution: by the distribution function, and as tables print it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import chdtr

from companion.study.chi_square import middle_95


@pytest.mark.parametrize("degrees", [1, 3, 10, 250, 4000])
def test_the_band_holds_nineteen_of_twenty(degrees: int) -> None:
    np.testing.assert_allclose(chdtr(degrees, middle_95(degrees)), [0.025, 0.975], rtol=1e-12)


@pytest.mark.parametrize(
    ("degrees", "low", "high"), [(1, 0.000982, 5.024), (3, 0.216, 9.348), (10, 3.247, 20.483), (100, 74.222, 129.561)]
)
def test_the_band_is_that_of_the_tables(degrees: int, low: float, high: float) -> None:
    np.testing.assert_allclose(middle_95(degrees), [low, high], rtol=0, atol=0.0005)
