"""The band of a chi-square distribution is that of `scipy.stats`."""

from __future__ import annotations

import numpy as np

from companion.study.chi_square import middle_95


def test_the_band_is_that_of_scipy() -> None:
    from scipy.stats import chi2  # here, since all else does without it

    for degrees in (1, 3, 10, 250, 4000):
        np.testing.assert_allclose(middle_95(degrees), chi2.ppf([0.025, 0.975], degrees), rtol=1e-12)
