"""The study of the team: what it leaves behind, and that its band is the one of the books."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.sim.team import TeamWorld, moments
from companion.study.team import STUDY, TURNING, TeamReport, TeamRow, band, reports, true_relative
from tests.unit.companion.study.few_trials import check_leftovers


def report(t_s: float, nees: float, degrees: int = 8) -> TeamReport:
    return TeamReport(
        t_s=t_s, nees=nees, degrees=degrees, placed=degrees // 4, place_error_m=0.5, heading_error_deg=1.0,
        turned_deg=0.0, turned_error_deg=1.0, update_s=0.05,
    )  # fmt: skip


def test_what_errs_as_it_says_is_in_the_band_nineteen_times_of_twenty() -> None:
    rng = np.random.default_rng(1)
    rows = [TeamRow("", 3, [report(2.0 * k, rng.chisquare(8)) for k in range(200)]) for _ in range(20)]
    assert band(rows).share == pytest.approx(0.95, abs=0.04)
    doubled = [replace(row, reports=[replace(one, nees=2 * one.nees) for one in row.reports]) for row in rows]
    assert band(doubled).share < 0.05
    assert min(band(rows).t_s) == 10.0


def test_before_half_the_robots_are_placed_nothing_is_judged() -> None:
    rows = [TeamRow("", 3, [report(20.0, 3.0, 4 if n else 0)]) for n in range(4)]
    assert band(rows).t_s == []


def test_places_are_in_the_first_robots_axes() -> None:
    (moment,) = (m for m in moments(TeamWorld(duration_s=0.0), np.random.default_rng(1)))
    moment.places_m[:2], moment.headings_rad[:2] = [[1.0, 1.0, 0.0], [1.0, 3.0, 1.0]], [np.pi / 2, np.pi]
    assert true_relative(moment)[0].tolist() == pytest.approx([2.0, 0.0, 1.0, np.pi / 2])


@pytest.mark.long
def test_a_few_trials_leave_findings_a_picture_and_a_page(tmp_path: Path) -> None:
    world = TeamWorld(robots=3, duration_s=34.0, turning_rad_s=0.005, turning_from_s=4.0)
    rows = [TeamRow(TURNING, 3, list(reports(world, np.random.default_rng(seed)))) for seed in (1, 2)]
    outcome = check_leftovers(STUDY, rows, tmp_path)
    found = {finding.quantity: finding.ours for finding in outcome.findings}
    assert found[f"{TURNING}: robots placed, from 30 s"] == 1.0
    alone, team = (found[f"one turns: by {how}, median"] for how in ("its poses alone", "the team"))
    assert isinstance(alone, float) and isinstance(team, float) and team < alone
