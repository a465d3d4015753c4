"""Places that are the same after a drawing part by as much as they are vague."""

from __future__ import annotations

import numpy as np
import pytest

from companion.guidance.twins import ACROSS, ALONG, SHARE, parted


@pytest.mark.parametrize(
    ("spread", "expected"), [(0.001, ALONG[0]), (0.2, SHARE * 0.2), (2.0, ALONG[1])], ids=["sure", "vague", "unknown"]
)
def test_they_part_along_the_line_of_sight_by_a_share_of_how_far_ranges_are_apart(
    spread: float, expected: float
) -> None:
    rng = np.random.default_rng(1)
    ranges_m = 10.0 * np.exp(rng.normal(0.0, spread, 4000))
    apart_m = parted(np.stack([ranges_m, 0 * ranges_m, 0 * ranges_m], axis=1), rng)
    along = np.log(apart_m[:, 0] / ranges_m)
    assert along.std() == pytest.approx(np.hypot(expected, ACROSS), rel=0.08)
    assert (apart_m[:, 1:] / ranges_m[:, None]).std() == pytest.approx(ACROSS, rel=0.08)
