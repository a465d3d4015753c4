"""Amplitude of a log of CSI over time and subcarriers."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from companion.analysis.csi_logs import Amplitudes

_ROWS: Final = 1500


def draw_amplitudes(path: Path, title: str, shown: Amplitudes) -> None:
    """One row for each packet, so that gaps in time do not stretch any; the axis says when. Raises OSError."""
    picked = np.unique(np.linspace(0, len(shown.t_s) - 1, _ROWS).astype(np.intp))
    power_db = 20 * np.log10(np.maximum(shown.amplitude[picked], 1e-3))
    low, high = np.percentile(power_db, [1, 99.5])
    figure = Figure(figsize=(8, 5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    mesh = axes.pcolormesh(
        _edges(shown.subcarrier_hz * 1e-6), np.arange(len(picked) + 1) - 0.5, power_db, cmap="gray", vmin=low, vmax=high
    )
    ticks = np.unique(np.linspace(0, len(picked) - 1, 8).astype(np.intp))
    axes.set_yticks(ticks, [f"{shown.t_s[picked[tick]]:.2f}" for tick in ticks])
    axes.set(xlabel="frequency from the centre [MHz]", ylabel="time of the packet [s]", title=title)
    figure.colorbar(mesh, label=f"antenna {shown.antenna} [dB, as the card counts]")
    figure.savefig(path, dpi=120)


def _edges(values: np.ndarray) -> np.ndarray:
    middles = (values[1:] + values[:-1]) / 2
    return np.concatenate([[2 * values[0] - middles[0]], middles, [2 * values[-1] - middles[-1]]])
