"""A bearing is an estimate in the local frame: everything that has a direction is turned alike."""

from __future__ import annotations

import math

import pytest

from companion.sensing.frame_turn import UNKNOWN, FrameTurn
from companion.sensing.records import Bearing, Iteration
from wsr.aoa import AoaEstimate
from wsr.directions import Peak

_ORIGIN = (0.0, 0.0, 0.0)


def _bearing(turn: FrameTurn) -> Bearing:
    paths = (
        Peak(azimuth_rad=0.5, polar_rad=1.4, power=0.8, relative_power=1.0),
        Peak(azimuth_rad=-2.0, polar_rad=1.6, power=0.2, relative_power=0.25),
    )
    estimate = AoaEstimate(
        azimuth_rad=0.5,
        polar_rad=1.4,
        azimuth_std_rad=0.03,
        polar_std_rad=0.03,
        covariance=((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, math.inf)),
        crb_rad=0.02,
        coherence=0.9,
        reliability=0.8,
        azimuth_observable=True,
        polar_observable=True,
        alternatives=(),
        packets=100,
        length_m=1.2,
        extents_m=_ORIGIN,
        reference_p_m=_ORIGIN,
        reference_t_s=0.0,
        paths=paths,
    )
    bearing = Iteration(
        number=1,
        peer=2,
        start_ns=0,
        end_ns=1,
        fresh=1.0,
        reference_ns=1,
        p_local_enu_m=_ORIGIN,
        peer_p_enu_m=_ORIGIN,
        peer_boot=1,
        received=100,
        power_dbm=-60.0,
        dropped={},
        compute_s=0.1,
        estimate=estimate,
        refusal="",
        turn=turn,
    ).bearing()
    assert bearing is not None
    return bearing


def test_bearings_are_turned_with_all_their_paths() -> None:
    plain, turned = _bearing(UNKNOWN), _bearing(FrameTurn(0.3, 0.02))
    assert (plain.azimuth_rad, plain.turn) == (0.5, UNKNOWN)
    assert turned.azimuth_rad == pytest.approx(0.8)
    assert turned.polar_rad == plain.polar_rad and turned.turn.std_rad == 0.02
    (other,) = turned.others
    assert other.azimuth_rad == pytest.approx(-1.7)
    assert (other.polar_rad, other.relative_power) == (1.6, 0.25)
