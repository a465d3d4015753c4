"""Two configurations on one flight as a picture; tells apart by marks and lines, not by colour."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from companion.replay.comparison import BearingRow


def draw_comparison(path: Path, rows: Sequence[BearingRow], flown: str, other: str) -> None:
    """Azimuth, how far it moved, and the error where the truth is known, over time. Raises OSError."""
    with_truth = any(row.recorded_error_deg is not None for row in rows)
    figure = Figure(figsize=(9, 8 if with_truth else 6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(3 if with_truth else 2, 1, sharex=True)
    t_s = [row.t_s for row in rows]
    sides = ((flown, "recorded", "o-"), (other, "replayed", "s--"))
    for label, side, style in sides:
        values = _numbers([getattr(row, f"{side}_azimuth_deg") for row in rows])
        panels[0].plot(
            t_s, values, style, color="black" if side == "recorded" else "0.45", label=label, fillstyle="none"
        )
    panels[0].set(
        ylabel="azimuth [deg from East]", title="each SAR iteration as flown, and with the other configuration"
    )
    panels[0].legend(loc="upper right")
    panels[1].bar(t_s, np.nan_to_num(_numbers([row.moved_deg for row in rows])), width=0.8, color="0.6", edgecolor="k")
    panels[1].set(ylabel="moved by [deg]")
    if with_truth:
        for label, side, style in sides:
            values = np.abs(_numbers([getattr(row, f"{side}_error_deg") for row in rows]))
            shade = "black" if side == "recorded" else "0.45"
            panels[2].plot(t_s, values, style, color=shade, label=label, fillstyle="none")
        panels[2].set(ylabel="|azimuth error| [deg]", ylim=(0, None))
        panels[2].legend(loc="upper right")
    for panel in panels:
        panel.grid(color="0.9")
    panels[-1].set(xlabel="time since the first event [s]")
    figure.savefig(path, dpi=120)


def _numbers(values: Sequence[float | None]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in values], float)
