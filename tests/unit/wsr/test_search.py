"""The search's own arithmetic, uncompiled; its scores and climbs are held in test_subapertures and test_focus."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from wsr import search


def _plain(kernel: Any) -> Any:
    return kernel.py_func


def test_its_angle_is_that_of_atan2_all_around() -> None:
    angle = _plain(search._angle)
    around = np.linspace(-math.pi, math.pi, 4001)
    x, y = (3.0 * np.cos(around)).astype(np.float32), (3.0 * np.sin(around)).astype(np.float32)
    found = np.array([angle(a, b) for a, b in zip(x, y, strict=True)], np.float64)
    off = found - np.arctan2(y, x, dtype=np.float64)
    assert np.abs(off - 2 * math.pi * np.round(off / (2 * math.pi))).max() < 1e-6
    assert angle(np.float32(0.0), np.float32(0.0)) == 0.0


def test_a_step_in_azimuth_grows_towards_the_pole_and_no_further_than_tenfold() -> None:
    climb = np.zeros(13)
    climb[search.STEP] = 0.01
    for polar_rad, factor in ((math.pi / 2, 1.0), (math.asin(0.5), 2.0), (0.01, 10.0)):
        climb[search.POLAR] = polar_rad
        across, down = _plain(search._steps)(climb)
        assert math.isclose(across, 0.01 * factor) and down == 0.01
    climb[search.PLANAR] = 1.0
    assert _plain(search._steps)(climb)[1] == 0.03, "over a level path the polar angle hardly shows"


def test_what_is_out_of_its_limits_is_at_them() -> None:
    assert [_plain(search._within)(value, 0.1, 2.0) for value in (-1.0, 0.1, 1.5, 2.0, 9.0)] == [
        0.1,
        0.1,
        1.5,
        2.0,
        2.0,
    ]
