"""A driving target's way is turned by what it takes for North."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.target_axes import AXES_STD_RAD, carried_m, drawn_axes, share_driven
from tests.unit.companion.guidance.test_tracker import bearing_to


def test_a_way_goes_on_where_its_axes_turn_it() -> None:
    told_m = np.array([2.0, 0.0, 0.3])
    more_m = carried_m(np.array([0.0, math.pi / 2, -math.pi / 6]), told_m)
    ways_m = [(2.0, 0.0, 0.3), (0.0, 2.0, 0.3), (math.sqrt(3.0), -1.0, 0.3)]
    np.testing.assert_allclose(told_m + more_m, ways_m, atol=1e-12)


def test_axes_are_as_uncertain_as_north_is() -> None:
    drawn = drawn_axes(np.random.default_rng(1), 4000)
    assert float(np.std(drawn)) == pytest.approx(AXES_STD_RAD, rel=0.05)
    assert float(np.mean(drawn)) == pytest.approx(0.0, abs=0.1 * AXES_STD_RAD)


@pytest.mark.parametrize(
    ("ours_m", "its_m", "share"),
    [((1.0, 0.0), (0.0, 0.0), 0.0), ((0.0, 0.0), (0.0, 1.0), 1.0), ((1.0, 0.0), (0.5, 0.0), 1.0),
     ((0.0, 3.0), (4.0, 0.0), 0.8), ((0.0, 0.0), (0.0, 0.0), 0.0)],
)  # fmt: skip
def test_what_of_the_path_is_the_targets(ours_m: tuple[float, float], its_m: tuple[float, float], share: float) -> None:
    """An aperture's path is ours less its own."""
    before = bearing_to(np.array([9.0, 0.0, 0.5]), np.array([0.0, 0.0, 1.5]), 0.0)
    after = replace(before, p_local_enu_m=(*ours_m, 1.5), target_p_enu_m=(*its_m, 0.0))
    assert share_driven(before, after) == pytest.approx(share)
