"""Figures of missions: shares with their intervals, errors by the paper's measure, and the page of them."""

from __future__ import annotations

import math

import pytest
from matplotlib.figure import Figure

from companion.study.belief import BeliefCheck
from companion.study.rendezvous_figures import by_scene, draw, scene_figures, summarise, table
from companion.study.study import Outcome
from tests.unit.companion.study.mission_rows import mission, step

_ROWS = [
    mission("hall", 0),
    mission("occluded", 0, time_s=60.0, straight_s=20.0),
    mission("occluded", 1, arrived_m=5.0, reached_s=None, time_s=90.0),
    mission("occluded", 2, arrived_m=None, end="holding", time_s=240.0),
]


def test_shares_are_of_all_missions_and_times_of_successes() -> None:
    figures = scene_figures(_ROWS[1:])
    assert figures["missions"] == 3
    assert figures["success"] == pytest.approx(1 / 3)
    assert figures["false_arrival"] == pytest.approx(1 / 3)
    assert figures["unsaid"] == pytest.approx(1 / 3)
    low, high = figures["success_low"], figures["success_high"]
    assert low is not None
    assert high is not None
    assert 0.0 < low < 1 / 3 < high < 1.0
    assert (figures["median_time_s"], figures["overhead"]) == (60.0, 3.0)


def test_without_a_success_or_an_estimate_there_are_no_numbers() -> None:
    figures = scene_figures([mission(arrived_m=None, steps=[step(0, None, belief=None)])])
    for name in ("median_time_s", "overhead", "aoa_mean_deg", "nees_mean", "held_90"):
        assert figures[name] is None
    for name in ("nees_in_band", "nees_mean_in_band"):
        assert figures[name] is None
    assert figures["estimates"] == 0


def test_a_report_is_held_where_its_own_error_is_what_one_report_may_have() -> None:
    beliefs = [BeliefCheck(nees, True, True) for nees in (0.21, 0.22, 3.0, 9.34, 9.36)]
    figures = scene_figures([mission(steps=[step(n, 1.0, belief=belief) for n, belief in enumerate(beliefs)])])
    assert figures["nees_in_band"] == pytest.approx(3 / 5)


def test_the_papers_number_leaves_out_the_two_worst_of_each_mission_on_its_way() -> None:
    errors = [1.0, 2.0, 3.0, 90.0, 120.0]
    row = mission("occluded", steps=[*(step(n, error) for n, error in enumerate(errors)), step(30, 170.0)])
    findings = {finding.quantity: finding for finding in summarise([row]).findings}
    own = next(f for name, f in findings.items() if name.startswith("occluded: mean AOA error on the way"))
    assert own.ours == pytest.approx(2.0)
    assert own.paper == 10.17
    assert findings["occluded: comes within 2 m"].ours == 100.0
    assert findings["occluded: mean AOA error (paper's measure)"].ours == pytest.approx((216 + 170) / 6)


def test_scenes_keep_their_order_and_ends_are_said() -> None:
    assert list(by_scene(_ROWS)) == ["hall", "occluded"]
    notes = " ".join(summarise(_ROWS).notes)
    assert "by the state they ended in: holding: 1." in notes
    assert "Every mission ended as arrived." in summarise(_ROWS[:1]).notes
    assert "Too few iterations" in summarise([mission(steps=[])]).notes[0]


def test_the_table_has_a_row_a_scene() -> None:
    outcome = Outcome(
        study="rendezvous", title="t", figures=(), seed=1, trials=4, elapsed_s=0.0, findings=[], notes=["n"], rows=_ROWS
    )
    hall, occluded = [line for line in table(outcome).splitlines() if line.startswith(("| hall", "| occluded"))]
    assert hall.startswith("| hall | 1 | 100 (20.7-100) | 0 (0-79.3) |")
    assert occluded.startswith("| occluded | 3 | 33.3 (")
    assert table(outcome).endswith("- n\n")


def test_everything_is_drawn_also_of_missions_that_saw_nothing() -> None:
    figure = Figure()
    draw([*_ROWS, mission("empty", steps=[], arrived_m=None)], figure)
    panels = figure.axes
    assert len(panels) == 6
    assert [label.get_text() for label in panels[4].get_yticklabels()] == ["hall", "occluded", "empty"]
    assert not math.isnan(panels[0].get_ylim()[1])
