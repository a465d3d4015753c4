"""A driving target's way is turned by what it takes for North."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.guidance.target_axes import AXES_STD_RAD, bend_rad, carried_m, drawn_axes, jumped_m
from companion.sensing.frame_turn import FrameTurn
from companion.sensing.records import Bearing
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
    [((1.0, 0.0), (0.0, 0.0), 0.0), ((0.0, 0.0), (0.0, 1.0), 1.0), ((0.0, 0.0), (1.0, 0.0), 0.0),
     ((3.0, 0.5), (0.0, 0.5), 0.5 / 3.0), ((0.0, 0.0), (0.0, 0.0), 0.0)],
)  # fmt: skip
def test_only_what_a_target_drives_across_bends_a_bearing(
    ours_m: tuple[float, float], its_m: tuple[float, float], share: float
) -> None:
    """It is seen in the east. An aperture's path is ours less its own."""
    before, after = _seen_in_the_east(ours_m, its_m)
    known = replace(after, turn=FrameTurn(0.0, 0.0))
    assert bend_rad(before, known) == pytest.approx(AXES_STD_RAD * share)
    turned = replace(after, turn=FrameTurn(0.2, 0.1))
    assert bend_rad(before, turned) == pytest.approx(math.hypot(AXES_STD_RAD, 0.2, 0.1) * share)


def test_a_way_that_nobody_drives_is_a_jump() -> None:
    before, after = _seen_in_the_east((0.3, 0.0), (0.0, 8.0))
    np.testing.assert_allclose(jumped_m(before, after), (0.0, 8.0, 0.0))
    much_later = replace(after, t_mono_ns=10_000_000_000)
    assert not jumped_m(before, much_later).any()


def _seen_in_the_east(ours_m: tuple[float, float], its_m: tuple[float, float]) -> tuple[Bearing, Bearing]:
    """A second apart."""
    before = bearing_to(np.array([9.0, 0.0, 0.5]), np.array([0.0, 0.0, 1.5]), 0.0)
    after = replace(
        before, t_mono_ns=1_000_000_000, p_local_enu_m=(*ours_m, 1.5), target_p_enu_m=(*its_m, 0.0), azimuth_rad=0.0
    )
    return before, after
