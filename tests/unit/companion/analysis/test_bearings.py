"""Bearings of recorded runs."""

from __future__ import annotations

import numpy as np
import pytest

from companion.analysis.bearings import analyze_run
from companion.analysis.result import Options
from companion.analysis.runs import find_runs
from companion.analysis.trajectories import PoseKind
from tests import paths

DATA = paths.DATA / "wsr_dataset_dev"
SPATIAL = DATA.parent / "wsr_3d"


def test_spatial_runs_give_both_transmitters_within_five_degrees() -> None:
    if not SPATIAL.is_dir():
        pytest.skip(f"no real captures at {SPATIAL}")
    links = [link for run in find_runs(SPATIAL) for link in analyze_run(run, Options(kind=PoseKind.MOCAP)).links]
    assert len(links) == 6
    for link in links:
        assert link.estimate is not None
        assert link.truth is not None
        assert link.azimuth_error_rad is not None, link.notes
        assert link.great_circle_error_rad is not None, link.notes
        assert abs(link.azimuth_error_rad) < np.radians(5)
        assert abs(link.estimate.polar_rad - link.truth.polar_rad) < np.radians(5)
