"""The paper's measure of an error."""

from __future__ import annotations

import math

import pytest

from companion.study.angles import aoa_error


def test_paper_measure_wraps_the_azimuth() -> None:
    error = aoa_error(math.radians(179), math.radians(93), math.radians(-179), math.radians(89))
    assert error.azimuth_deg == pytest.approx(2.0)
    assert error.paper_deg == pytest.approx(math.hypot(2.0, 4.0))
    assert error.great_circle_deg == pytest.approx(error.paper_deg, rel=0.01)
