"""What an analysis found, for people and for programs."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from companion.analysis.result import DEFAULT_LEVERS_M, Direction, LinkResult, RunResult
from companion.analysis.runs import Run
from companion.analysis.summary import as_json, lever_line, note_lines, problem_lines, summarise
from companion.analysis.trajectories import PoseKind
from tests.unit.companion.analysis.estimates import estimate
from wsr.aoa import Cone

_RUN = Run(stamp="2026-01-02_030405", folder=Path("/data/LOS_A/L1"), rx=None)


def _link(error_deg: float, name: str = "tx1") -> LinkResult:
    return LinkResult(name=name, estimate=estimate(azimuth_rad=math.radians(error_deg)), truth=Direction(0.0, 1.5))


def _result(*links: LinkResult, folder: str = "/data/LOS_A/L1") -> RunResult:
    return RunResult(run=replace(_RUN, folder=Path(folder)), kind=PoseKind.MOCAP, links=links)


def test_errors_are_summed_up_by_set_over_links_whose_truth_is_known() -> None:
    results = [
        _result(_link(2.0), _link(-4.0), _link(15.0), LinkResult(name="tx4", problem="no packets")),
        _result(_link(1.0), folder="/data/NLOS_A/L1"),
        _result(LinkResult(name="tx1", estimate=estimate()), folder="/data/OTHER/L1"),
    ]
    los, nlos = summarise(results)
    assert (los.name, los.links, los.of_links) == ("LOS_A", 3, 4)
    assert (los.median_deg, los.mean_deg) == pytest.approx((4.0, 7.0))
    assert los.share_below_10_deg == pytest.approx(2 / 3)
    assert nlos.name == "NLOS_A"


def test_a_set_of_failures_has_no_errors_and_is_counted() -> None:
    failed = LinkResult(name="tx1", truth=Direction(0.0, 1.0), problem="too few packets")
    (row,) = summarise([_result(failed)])
    assert (row.links, row.of_links, row.median_deg, row.share_below_10_deg) == (0, 1, None, None)


def test_what_is_wrong_is_said_once_with_the_name_of_its_link() -> None:
    link = LinkResult(name="tx2", problem="no packets", notes=("tx2's log is cut",))
    result = replace(_result(link, link), missing=("a is missing",), problems=("b drifts",), failure="c failed")
    assert problem_lines(result) == [
        "a is missing", "b drifts", "c failed", "tx2: tx2's log is cut", "tx2: no packets",
    ]  # fmt: skip


def test_what_was_assumed_is_said() -> None:
    odometry = replace(
        _result(), kind=PoseKind.ODOM, lever_m=DEFAULT_LEVERS_M[PoseKind.ODOM], trajectory=Path("t.csv"), layout="TUM"
    )
    first, second = note_lines(odometry)
    assert first == "trajectory t.csv, read as TUM"
    assert second == lever_line(odometry.lever_m)
    assert "that of the WSR robot; --lever gives another" in second
    assert "0.1 m forward, 0 m left, -0.2 m up of the tracked point (as given)" in lever_line((0.1, 0.0, -0.2))
    assert note_lines(replace(odometry, kind=PoseKind.T265)) == [first]


def test_programs_get_plain_numbers_in_degrees() -> None:
    cone = Cone((1.0, 0.0, 0.0), 0.5, math.inf)
    level = replace(_link(3.0), estimate=estimate(polar_observable=False, polar_std_rad=math.inf, cone=cone))
    (told,) = json.loads(json.dumps(as_json([_result(level, LinkResult(name="tx9"))]), allow_nan=False))["runs"]
    seen, empty = told["links"]
    assert (seen["azimuth_deg"], seen["polar_deg"], seen["elevation_deg"]) == (0.0, None, None)
    assert seen["polar_std_deg"] is None
    assert seen["true_elevation_deg"] == pytest.approx(90.0 - math.degrees(1.5))
    assert seen["cone"]["angle_deg"] == pytest.approx(math.degrees(0.5))
    assert seen["cone"]["angle_std_deg"] is None
    assert (empty["azimuth_deg"], empty["used"]) == (None, 0)
    assert (told["run"], told["set"], told["poses"]) == ("2026-01-02_030405", "LOS_A", "mocap")
