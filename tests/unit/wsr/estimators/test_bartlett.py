"""The paper's estimator: one subcarrier, seen from the first position."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.unit.wsr.scene import aperture_towards, circle, error_deg, far, weave
from wsr.estimators.bartlett import Bartlett
from wsr.geometry import direction

U = direction(2.1, 1.35)


def test_the_highest_point_of_the_grid_seen_from_the_first_position() -> None:
    t, p = weave(400)
    source = p.mean(axis=0) + 40.0 * U[None, :]
    aperture = aperture_towards(t, p, source)
    estimate, profile = Bartlett().estimate(aperture)
    assert error_deg(estimate, source) < 1.5
    assert estimate.reference_p_m == pytest.approx(tuple(p[0]))
    assert estimate.reference_t_s == t[0]
    assert estimate.paths[0].power == pytest.approx(float(profile.power.max()))
    assert estimate.range_m is None


@pytest.mark.parametrize("subcarrier", [0, 29, 99])
def test_another_subcarrier_serves_as_well(subcarrier: int) -> None:
    """Numbers above the last mean the last."""
    t, p = weave(300)
    source = far(p, U)
    estimate, _ = Bartlett(subcarrier).estimate(aperture_towards(t, p, source))
    assert error_deg(estimate, source) < 1.5


def test_without_subcarriers_the_product_is_taken() -> None:
    t, p = weave(300)
    source = far(p, U)
    bare = replace(aperture_towards(t, p, source), forward=None, reverse=None)
    assert error_deg(Bartlett().estimate(bare)[0], source) < 1.5


def test_the_image_through_a_level_path_is_named_and_no_second_path() -> None:
    t, p = circle(300)
    estimate, _ = Bartlett().estimate(aperture_towards(t, p, far(p, U)))
    (image,) = estimate.alternatives
    assert image.azimuth_rad == pytest.approx(estimate.azimuth_rad, abs=1e-6)
    assert image.polar_rad == pytest.approx(np.pi - estimate.polar_rad)
    assert all(abs(path.polar_rad - image.polar_rad) > 0.1 or path.azimuth_rad != image.azimuth_rad
               for path in estimate.paths)  # fmt: skip


def test_deviations_hold_what_the_distance_to_the_first_position_may_turn() -> None:
    """On a path twice as wide the first position is twice as far off the middle."""
    small, large = (
        Bartlett().estimate(aperture_towards(t, p, far(p, U)))[0] for t, p in (circle(300, 0.2), circle(300, 0.4))
    )
    assert large.azimuth_std_rad > 1.5 * small.azimuth_std_rad
    assert small.covariance[0][0] == pytest.approx(small.azimuth_std_rad**2)
