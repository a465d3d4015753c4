"""Tables on the terminal: every link a row, and names shown as they are."""

from __future__ import annotations

import io
import math
from pathlib import Path

from rich.console import Console
from rich.table import Table

from companion.analysis.evaluation import Figures
from companion.analysis.result import Direction, LinkResult, RunResult
from companion.analysis.runs import Run
from companion.analysis.summary import SetSummary
from companion.analysis.trajectories import PoseKind
from companion.commands.tables import figures_table, run_table, summary_table
from tests.unit.companion.analysis.estimates import estimate


def _rows(table: Table) -> list[list[str]]:
    """The cells of each line, as a wide terminal shows them."""
    out = io.StringIO()
    Console(file=out, width=200).print(table)
    return [[cell.strip() for cell in line.split("│")] for line in out.getvalue().splitlines() if "│" in line]


def test_a_link_is_told_in_degrees_above_the_horizon_and_what_is_not_known_by_a_dash() -> None:
    known = LinkResult(
        name="tx1", packets=500, dropped={"weak": 3}, truth=Direction(math.radians(38.0), math.radians(80.0)),
        estimate=estimate(azimuth_rad=math.radians(40.0), polar_rad=math.radians(83.0)),
    )  # fmt: skip
    level = LinkResult(name="[b]tx2", packets=9, estimate=estimate(polar_observable=False))
    run = Run(stamp="2026-01-02_030405", folder=Path("/data/LOS_A/L1"), rx=None)
    table = run_table(RunResult(run=run, kind=PoseKind.MOCAP, links=(known, level, LinkResult(name="tx3"))))
    first, second, third = _rows(table)[-3:]
    assert first[1:-1] == ["tx1", "40.0°", "7.0°", "38.0°", "10.0°", "+2.0°", "3.6°", "100/500", "3 weak", "0.80"]
    assert second[1:4] == ["[b]tx2", "0.0°", "-"]
    assert third[1:-1] == ["tx3", "-", "-", "-", "-", "-", "-", "0/0", "none", "-"]


def test_sets_without_an_error_have_dashes_and_failures_are_counted() -> None:
    table = summary_table(
        [
            SetSummary(name="LOS", links=3, of_links=4, median_deg=1.24, mean_deg=2.0, share_below_10_deg=0.75),
            SetSummary(name="NLOS", links=0, of_links=2, median_deg=None, mean_deg=None, share_below_10_deg=None),
        ]
    )
    los, nlos = _rows(table)[-2:]
    assert los[1:-1] == ["LOS", "3 of 4", "1.2°", "2.0°", "75%"]
    assert nlos[1:-1] == ["NLOS", "0 of 2", "-", "-", "-"]


def test_figures_may_be_a_share_of_others() -> None:
    few, all_ = (
        {"LOS": Figures(n=2, median_deg=1.0, mean_deg=1.5, p90_deg=2.0, within_10=1.0)},
        {"LOS": Figures(n=5, median_deg=2.0, mean_deg=3.0, p90_deg=9.0, within_10=0.8)},
    )
    assert _rows(figures_table("t", few))[-1][1:-1] == ["LOS", "2", "1.00°", "1.50°", "2.0°", "100%"]
    assert _rows(figures_table("t", few, all_))[-1][2] == "2 of 5"
