"""Tables on the terminal: what an analysis and an evaluation found."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from rich.table import Table
from rich.text import Text

from companion.analysis.evaluation import Figures
from companion.analysis.result import LinkResult, RunResult
from companion.analysis.summary import SetSummary

_COLUMNS = (
    ("tx", "left"),
    ("azimuth", "right"),
    ("elevation", "right"),
    ("true az.", "right"),
    ("true el.", "right"),
    ("az. error", "right"),
    ("3D error", "right"),
    ("packets", "right"),
    ("dropped", "left"),
    ("reliability", "right"),
)


def run_table(result: RunResult) -> Table:
    """One row per transmitter."""
    table = Table(
        title=Text(f"{result.run.title}  ({result.kind}); azimuth from East, elevation above the horizon"),
        title_justify="left",
        title_style="bold",
    )
    for name, justify in _COLUMNS:
        table.add_column(name, justify=justify, no_wrap=name != "dropped")  # type: ignore[arg-type]
    for link in result.links:
        table.add_row(*map(Text, _cells(link)))  # as Text: names may hold brackets, which rich would take for markup
    return table


def summary_table(summaries: Sequence[SetSummary]) -> Table:
    """Median, mean and share below 10 degrees of |azimuth error| by set."""
    table = Table(title="|azimuth error| by set", title_justify="left", title_style="bold")
    for column in ("set", "links", "median", "mean", "below 10°"):
        table.add_column(column, justify="left" if column == "set" else "right")
    for row in summaries:
        count = str(row.links) if row.links == row.of_links else f"{row.links} of {row.of_links}"
        share = "-" if row.share_below_10_deg is None else f"{row.share_below_10_deg:.0%}"
        angles = ("-" if angle is None else f"{angle:.1f}°" for angle in (row.median_deg, row.mean_deg))
        table.add_row(Text(row.name), count, *angles, share)
    return table


def figures_table(title: str, figures: Mapping[str, Figures], of: Mapping[str, Figures] | None = None) -> Table:
    """One row for each set. With `of`, the links kept are shown as a share of those."""
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("set")
    for heading in ("links", "median", "mean", "90th pct", "below 10°"):
        table.add_column(heading, justify="right")
    for name, row in figures.items():
        angles = (f"{row.median_deg:.2f}°", f"{row.mean_deg:.2f}°", f"{row.p90_deg:.1f}°")
        links = str(row.n) if of is None else f"{row.n} of {of[name].n}"
        table.add_row(Text(name), links, *angles, f"{row.within_10:.0%}")
    return table


def _cells(link: LinkResult) -> Iterator[str]:
    estimate, truth = link.estimate, link.truth
    yield link.name
    yield _degrees(estimate.azimuth_rad if estimate and estimate.azimuth_observable else None)
    yield _elevation(estimate.polar_rad if estimate and estimate.polar_observable else None)
    yield _degrees(truth.azimuth_rad if truth else None)
    yield _elevation(truth.polar_rad if truth else None)
    yield _degrees(link.azimuth_error_rad, signed=True)
    yield _degrees(link.great_circle_error_rad)
    yield f"{link.used}/{link.packets}"
    yield ", ".join(f"{count} {reason}" for reason, count in link.dropped.items()) or "none"
    yield f"{estimate.reliability:.2f}" if estimate else "-"


def _elevation(polar_rad: float | None) -> str:
    """Above the horizon: the one vertical angle that a person is shown."""
    return _degrees(None if polar_rad is None else math.pi / 2 - polar_rad)


def _degrees(angle_rad: float | None, signed: bool = False) -> str:
    if angle_rad is None:
        return "-"
    return f"{math.degrees(angle_rad):{'+' if signed else ''}.1f}°"
