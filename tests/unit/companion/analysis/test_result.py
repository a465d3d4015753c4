"""Errors of a link against the truth, where both are known."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from companion.analysis.result import DEFAULT_LEVERS_M, NO_LEVER, Direction, LinkResult
from companion.analysis.trajectories import PoseKind
from tests.unit.companion.analysis.estimates import estimate


def test_the_azimuth_error_is_signed_and_goes_around() -> None:
    link = LinkResult(name="tx1", estimate=estimate(azimuth_rad=3.1), truth=Direction(-3.1, 1.5))
    assert link.azimuth_error_rad == pytest.approx(6.2 - math.tau)
    assert link.used == 100


def test_the_great_circle_counts_both_angles() -> None:
    link = LinkResult(name="tx1", estimate=estimate(azimuth_rad=0.1, polar_rad=1.4), truth=Direction(0.0, 1.5))
    assert link.great_circle_error_rad == pytest.approx(math.hypot(0.1 * math.sin(1.45), 0.1), rel=0.01)


@pytest.mark.parametrize(
    ("link", "azimuth", "circle"),
    [
        (LinkResult(name="x"), False, False),
        (LinkResult(name="x", estimate=estimate()), False, False),
        (LinkResult(name="x", truth=Direction(0.0, 1.0)), False, False),
        (LinkResult(name="x", estimate=estimate(polar_observable=False), truth=Direction(0.0, 1.0)), True, False),
        (LinkResult(name="x", estimate=estimate(azimuth_observable=False), truth=Direction(0.0, 1.0)), False, False),
    ],
)
def test_what_is_not_observable_or_not_known_has_no_error(link: LinkResult, azimuth: bool, circle: bool) -> None:
    assert (link.azimuth_error_rad is not None) == azimuth
    assert (link.great_circle_error_rad is not None) == circle


def test_without_an_estimate_nothing_was_used() -> None:
    assert LinkResult(name="x", packets=500).used == 0
    assert replace(LinkResult(name="x"), estimate=estimate(packets=7)).used == 7


def test_every_kind_of_poses_has_a_place_for_the_antenna() -> None:
    assert set(DEFAULT_LEVERS_M) == set(PoseKind)
    assert DEFAULT_LEVERS_M[PoseKind.MOCAP] == DEFAULT_LEVERS_M[PoseKind.T265] == NO_LEVER
