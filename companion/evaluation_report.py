"""Tables of an evaluation for the terminal."""

from __future__ import annotations

from collections.abc import Mapping

from rich.table import Table
from rich.text import Text

from companion.evaluation import Figures


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
