"""Iterations of two configurations side by side, and the transitions of the mission."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from companion.core.streams import BEARING, MISSION, SETPOINT, Stream
from companion.log.reader import LoggedMessage
from companion.log.records import LoggedEstimate, LoggedIteration
from companion.replay.comparison import Step, bearing_rows, iterations_of, mission_steps
from companion.replay.player import Decided

_S = 10**9


def _iteration(start_s: float, azimuth_deg: float | None, peer: int = 2, **estimate: Any) -> LoggedIteration:
    """One of two seconds; without an azimuth it was refused."""
    values: dict[str, Any] = {"polar_rad": 1.5, "reliability": 0.8, "packets": 100, "length_m": 1.2} | estimate
    return LoggedIteration(
        number=1, peer=peer, start_ns=round(start_s * _S), end_ns=round((start_s + 2) * _S),
        reference_ns=round((start_s + 1) * _S), received=100,
        estimate=None if azimuth_deg is None else LoggedEstimate(azimuth_rad=math.radians(azimuth_deg), **values),
        refusal="" if azimuth_deg is not None else "too short",
    )  # fmt: skip


def test_iterations_of_one_peer_that_overlap_stand_in_one_row() -> None:
    recorded = [_iteration(10, 40.0), _iteration(20, -179.0), _iteration(30, None)]
    replayed = [_iteration(11, 43.0), _iteration(20.5, 179.0), _iteration(10, 7.0, peer=3), _iteration(50, 1.0)]
    rows = bearing_rows(recorded, replayed, 10 * _S, {})
    assert [(row.peer, row.t_s) for row in rows] == [(2, 1.0), (3, 1.0), (2, 11.0), (2, 21.0), (2, 41.0)]
    first, other, seam, lost, late = rows
    assert first.moved_deg == pytest.approx(3.0 * math.sin(1.5), abs=0.01)
    assert other.recorded_azimuth_deg is None
    assert other.replayed_azimuth_deg == pytest.approx(7.0)
    assert seam.moved_deg == pytest.approx(2.0, abs=0.01)
    assert (lost.recorded_refusal, lost.replayed_azimuth_deg, lost.moved_deg) == ("too short", None, None)
    assert (late.recorded_azimuth_deg, late.recorded_refusal) == (None, "")


def test_without_a_polar_angle_it_is_told_along_the_horizon() -> None:
    level = _iteration(0, 40.0, polar_rad=0.3, polar_observable=False)
    (row,) = bearing_rows([level], [_iteration(0, 44.0)], 0, {})
    assert row.moved_deg == pytest.approx(4.0)


def test_errors_are_against_the_truth_of_each_ones_own_time() -> None:
    truth = {(2, 1 * _S): math.radians(38.0), (2, round(1.5 * _S)): math.radians(45.0)}
    (row,) = bearing_rows([_iteration(0, 40.0)], [_iteration(0.5, 44.0)], 0, truth)
    assert (row.recorded_error_deg, row.replayed_error_deg) == pytest.approx((2.0, -1.0))
    (unknown,) = bearing_rows([_iteration(0, 40.0)], [_iteration(0.5, 44.0)], 0, {})
    assert (unknown.recorded_error_deg, unknown.replayed_error_deg) == (None, None)


def _logged(stream: Stream, data: bytes) -> LoggedMessage:
    return LoggedMessage(topic=stream.topic, log_time_ns=0, data=data, publish_time_ns=0)


def _decided(stream: Stream, data: bytes) -> Decided:
    return Decided(stream=stream, t_ns=0, own_t_ns=0, event=0, source=data, data=data)


@pytest.mark.parametrize("made", [_logged, _decided])
def test_both_sides_are_read_alike(made: Any) -> None:
    step = {"t_mono_ns": 12 * _S, "state": "idle", "next_state": "preflight", "event": "engage", "reason": ""}
    bearing = {
        "number": 7, "peer": 2, "start_ns": 0, "end_ns": 1, "reference_ns": 1, "received": 9, "estimate": None,
        "refusal": "few", "what a newer version adds": 1,
    }  # fmt: skip
    messages = [
        made(MISSION, json.dumps(step).encode()), made(SETPOINT, b"{}"), made(BEARING, json.dumps(bearing).encode()),
    ]  # fmt: skip
    assert mission_steps(messages, 10 * _S) == [Step(2.0, "idle -> preflight on engage")]
    assert [one.number for one in iterations_of(messages)] == [7]
