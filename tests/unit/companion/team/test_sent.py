"""What goes out is what one aperture gave: nothing of it can depend on what the others said."""

from __future__ import annotations

import ast
import inspect
import math
from dataclasses import replace

import pytest

from companion.sensing.records import Iteration
from companion.team import sent
from companion.team.sent import sighting_of
from wsr.aoa import AoaEstimate

ESTIMATE = AoaEstimate(
    azimuth_rad=0.5,
    polar_rad=1.5,
    reliability=0.8,
    azimuth_std_rad=0.03,
    polar_std_rad=0.1,
    covariance=((0.0009, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, math.inf)),
    crb_rad=0.01,
    coherence=0.8,
    azimuth_observable=True,
    polar_observable=True,
    alternatives=(),
    packets=300,
    length_m=1.2,
    extents_m=(0.3, 0.2, 0.1),
    reference_p_m=(0.0, 0.0, 0.0),
    reference_t_s=1.0,
)
ITERATION = Iteration(
    number=70_000, peer=2, start_ns=0, end_ns=2, fresh=0.2, reference_ns=1, p_local_enu_m=None, peer_p_enu_m=None,
    peer_boot=1, received=300, power_dbm=-50.0, dropped={}, compute_s=0.1, estimate=ESTIMATE, refusal="",
)  # fmt: skip


def test_a_bearing_goes_out_as_it_was_measured() -> None:
    one = sighting_of(ITERATION)
    assert one is not None
    assert (one.target, one.number, one.t_ns, one.fresh, one.reliability) == (2, 70_000 & 0xFFFF, 1, 0.2, 0.8)
    assert (one.azimuth_rad, one.azimuth_std_rad, one.polar_rad, one.polar_std_rad) == (0.5, 0.03, 1.5, 0.1)


def test_an_angle_that_was_not_observed_is_not_told() -> None:
    flat = sighting_of(replace(ITERATION, estimate=replace(ESTIMATE, polar_observable=False)))
    assert flat is not None and math.isinf(flat.polar_std_rad)


@pytest.mark.parametrize(
    "estimate",
    [None, replace(ESTIMATE, azimuth_observable=False), replace(ESTIMATE, azimuth_std_rad=7.0)],
)
def test_where_nothing_was_measured_nothing_goes_out(estimate: AoaEstimate | None) -> None:
    assert sighting_of(replace(ITERATION, estimate=estimate)) is None


def test_what_goes_out_knows_nothing_of_the_team() -> None:
    """No information comes back to who measured it: what is sent imports neither estimate nor tracker."""
    imported = {
        node.module for node in ast.walk(ast.parse(inspect.getsource(sent))) if isinstance(node, ast.ImportFrom)
    }
    assert imported == {"__future__", "companion.neighbours.sightings", "companion.sensing.records"}
