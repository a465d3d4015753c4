"""The search over directions and ranges, on parts that a source at a known place gives."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tests.unit.wsr.scene import WAVELENGTH_M, Array, circle, weave
from wsr.focus import Bounds, Look, circle_grid, look, look_around, refine, sphere_directions, sphere_grid
from wsr.geometry import direction, great_circle
from wsr.subapertures import SubApertures, sub_apertures

STEP_RAD = math.radians(4.0)
AT = (2.1, 1.2)


def _parts(p: Array, range_m: float) -> SubApertures:
    """Of one subcarrier and no noise; the source is seen from the middle of the path."""
    d = np.linalg.norm(p.mean(axis=0) + range_m * direction(*AT) - p, axis=1)
    wave = np.exp(-2j * np.pi / WAVELENGTH_M * d)[:, None]
    return sub_apertures(p, wave, np.zeros(len(p), np.int64), WAVELENGTH_M, scales=(1, 2, 4))


def _off_rad(azimuth_rad: float, polar_rad: float) -> float:
    return float(great_circle(direction(azimuth_rad, polar_rad), direction(*AT)))


def _best(seen: Look) -> tuple[int, int]:
    n, r = np.unravel_index(np.argmax(seen.combined), seen.combined.shape)
    return int(n), int(r)


def test_the_sphere_is_covered() -> None:
    """No direction is further from a point of the grid than a step, and all rows are whole."""
    azimuth, polar, rows = sphere_grid(STEP_RAD)
    assert rows[0] == 0
    assert rows[-1] == azimuth.size == polar.size
    assert all(np.ptp(polar[a:b]) == 0.0 for a, b in itertools.pairwise(rows))
    rng = np.random.default_rng(0)
    anywhere = rng.normal(size=(500, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    nearest = (anywhere @ sphere_directions(STEP_RAD).T).max(axis=1)
    assert math.acos(nearest.min()) < STEP_RAD


def test_circles_are_whole_at_each_polar_angle() -> None:
    azimuth, polar, rows = circle_grid(math.radians(10.0), (1.4, 1.1))
    assert rows.tolist() == [0, 36, 72]
    np.testing.assert_allclose(azimuth[:36], azimuth[36:])
    assert polar.tolist() == [1.4] * 36 + [1.1] * 36


def test_a_look_sees_the_source_where_it_is_and_how_far() -> None:
    seen = look(_parts(weave(300)[1], 2.0), STEP_RAD, (2.0, 7.0, 30.0), None)
    n, r = _best(seen)
    assert _off_rad(float(seen.azimuth_rad[n]), float(seen.polar_rad[n])) < STEP_RAD
    assert seen.ranges_m[r] == 2.0
    assert seen.power.max() == 1.0


def test_a_look_around_sees_the_azimuth_from_a_level_path() -> None:
    seen = look_around(_parts(circle(300)[1], 30.0), circle_grid(STEP_RAD, (AT[1], 1.5)), (7.0, None), None)
    n, _ = _best(seen)
    assert abs(float(seen.azimuth_rad[n]) - AT[0]) < STEP_RAD
    assert float(seen.polar_rad[n]) == AT[1]


@pytest.mark.parametrize("range_m", [1.5, 6.0])
def test_the_climb_ends_at_the_source(range_m: float) -> None:
    parts = _parts(weave(300)[1], range_m)
    start = (AT[0] + 0.03, AT[1] - 0.02, 1.3 * range_m)
    found = refine(
        parts,
        start,
        peak=np.ones(3),
        step_rad=STEP_RAD,
        beam_rad=0.06,
        bounds=Bounds(),
        delay_ns=None,
        coherent_above=0.8,
        steps=12,
    )
    assert _off_rad(found.azimuth_rad, found.polar_rad) < math.radians(0.05)
    assert found.range_m == pytest.approx(range_m, rel=0.05)
    assert found.coherence == pytest.approx(1.0, abs=1e-3)


def test_the_climb_keeps_to_its_bounds_and_to_the_far_field() -> None:
    parts = _parts(weave(300)[1], 2_000.0)
    low = AT[1] + 0.05
    found = refine(
        parts,
        (AT[0], AT[1] + 0.06, None),
        peak=np.ones(3),
        step_rad=STEP_RAD,
        beam_rad=0.06,
        bounds=Bounds(low_rad=low),
        delay_ns=None,
        coherent_above=0.8,
        steps=8,
    )
    assert found.range_m is None
    assert found.polar_rad == low
