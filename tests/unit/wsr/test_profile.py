"""The variance of a profile."""

from __future__ import annotations

import numpy as np
import pytest

from wsr.profile import AZIMUTH_RAD, POLAR_RAD, Profile, profile_variance


def test_profile_variance_is_one_without_a_peak_and_small_with_one() -> None:
    flat = Profile(np.ones((180, 360), np.float32), AZIMUTH_RAD, POLAR_RAD)
    assert profile_variance(flat, 0.3, POLAR_RAD[90]) == pytest.approx(1.0, rel=1e-3)
    peaked = Profile(np.full((180, 360), 1e-9, np.float32), AZIMUTH_RAD, POLAR_RAD)
    peaked.power[90, 20] = 1.0
    assert profile_variance(peaked, AZIMUTH_RAD[20], POLAR_RAD[90]) < 0.01
