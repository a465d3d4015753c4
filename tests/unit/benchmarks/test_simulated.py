"""The simulated campaigns of `python -m benchmarks.simulated`, with few trials: bound, near field, wrong poses."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scenes import WAVELENGTH_M
from benchmarks.simulated import (
    arbitrary_path,
    bound_rows,
    error_rad,
    helix_path,
    near_row,
    pose_error_rows,
    simulated,
)
from wsr.estimators.options import RobustOptions
from wsr.estimators.robust import Robust


@pytest.mark.long
@pytest.mark.parametrize("trials", [4, 12])
def test_errors_reach_the_bound_with_unknown_phase(trials: int) -> None:
    """Over 12 trials of both angles the mean of err^2 / bound scatters by 0.3 about 1, over these 4 it is below too."""
    for row in bound_rows(trials, (10.0,)):
        assert (row.azimuth_ratio + row.polar_ratio) / 2 < 1.5, row


def test_a_climb_from_the_wrong_range_is_not_the_last_word() -> None:
    """Of this path the highest coarse cell is of a range and direction whose climb ends on a side lobe."""
    rng = np.random.default_rng([1, 101])
    trial = simulated(rng, arbitrary_path(rng), 8.0, 20.0)
    assert np.degrees(error_rad(trial, Robust().estimate(trial.aperture)[0])[2]) < 0.05


def test_a_velocity_error_over_a_level_curve() -> None:
    """A level path tells the linear phase from an azimuth where it is curved."""
    errors_deg: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(6):
        rng = np.random.default_rng([9, seed])
        path = arbitrary_path(rng)
        path[:, 2] = 0.0
        wrong = np.linspace(0.0, 1.0, len(path))[:, None] * np.array([0.12, -0.1, 0.0])
        trial = simulated(rng, path, 10.0, 20.0, pose_error_m=wrong, level=True)
        for drift, errors in errors_deg.items():
            estimate = Robust(RobustOptions(drift=drift)).estimate(trial.aperture)[0]
            errors.append(abs(float(np.degrees(error_rad(trial, estimate)[0]))))
    assert np.median(errors_deg[True]) < 0.3 * np.median(errors_deg[False])


def test_near_field_bias_is_gone_and_range_is_known() -> None:
    row = near_row(10)
    assert 0.5 < row.far_field_deg < 4.0
    assert row.robust_deg < 0.05
    assert row.range_within_15 >= 0.8


@pytest.mark.long
def test_velocity_bias_and_random_walk() -> None:
    bias, walk = pose_error_rows(15)
    assert bias.ate_m == pytest.approx(walk.ate_m)
    assert bias.robust_median_deg < 0.3 * bias.bartlett_median_deg
    assert walk.robust_median_deg <= walk.bartlett_median_deg
    assert walk.robust_mean_deg <= walk.bartlett_mean_deg


@pytest.mark.long
def test_the_linear_phase_is_found_where_it_is_and_not_in_noise() -> None:
    rng = np.random.default_rng(11)
    path = helix_path(rng)
    wrong = np.linspace(0.0, 1.0, len(path))[:, None] * np.array([0.1, -0.1, 0.08])
    trial = simulated(rng, path, 10.0, 20.0, pose_error_m=wrong)
    with_, without = Robust(), Robust(RobustOptions(drift=False))
    found = with_.estimate(trial.aperture)[0]
    turns = float(wrong[-1] @ (trial.source_m - path.mean(axis=0))) / 10.0 / WAVELENGTH_M
    assert abs(found.drift_turns) == pytest.approx(abs(turns), abs=0.5)
    assert error_rad(trial, found)[2] < 0.2 * error_rad(trial, without.estimate(trial.aperture)[0])[2]
    clean = simulated(rng, path, 10.0, 5.0)
    assert with_.estimate(clean.aperture)[0].drift_turns == 0.0
