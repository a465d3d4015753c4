"""The median is numpy's, to the last digit."""

import numpy as np
import pytest

from wsr.middle import median


@pytest.mark.parametrize("size", [1, 2, 3, 16, 17, 250, 251])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_it_is_that_of_numpy(size: int, kind: type[np.floating]) -> None:
    values = np.random.default_rng(size).normal(size=size).astype(kind)
    assert median(values) == float(np.median(values))
    assert median(np.abs(values)) == float(np.median(np.abs(values)))


def test_the_values_stay_in_their_order() -> None:
    values = np.array([3.0, 1.0, 2.0])
    assert median(values) == 2.0
    assert values.tolist() == [3.0, 1.0, 2.0]
