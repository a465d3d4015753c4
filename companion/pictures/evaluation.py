"""Pictures of an evaluation: error CDFs in the paper's manner, and what leaving out unreliable estimates gains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from companion.analysis.evaluation import Evaluation, risk_coverage

_STYLES = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)))


def draw_error_cdfs(path: Path, result: Evaluation) -> None:
    """Share of links below an error, one line for each set; readable without colour."""
    figure = Figure(figsize=(7, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    for number, name in enumerate(sorted({row.set for row in result.links})):
        errors = np.sort([row.error_deg for row in result.links if row.set == name])
        share = np.arange(1, len(errors) + 1) / len(errors)
        label = f"{name}: median {np.median(errors):.1f}°, n = {len(errors)}"
        axes.step([0, *errors], [0, *share], where="post", linestyle=_STYLES[number % len(_STYLES)], label=label)
    axes.axvline(10, color="0.7", linewidth=0.8)
    axes.set(
        xlabel="|azimuth error| [deg]",
        ylabel="share of links",
        xlim=(0, 60),
        ylim=(0, 1.02),
        title=f"AOA error, {result.estimator}, poses from {result.poses}",
    )
    axes.grid(color="0.92")
    axes.legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=130)


def draw_risk_coverage(path: Path, result: Evaluation) -> None:
    """Mean error of the most reliable links against the share of links kept."""
    figure = Figure(figsize=(7, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot(*risk_coverage(result.links), color="black", label="most reliable first")
    axes.plot(*risk_coverage(result.links, by_profile_variance=True), "k:", label="lowest profile variance first")
    mean = float(np.mean([row.error_deg for row in result.links]))
    axes.axhline(mean, color="0.5", linestyle="--", label=f"all links: {mean:.1f}°")
    axes.set(
        xlabel="share of links kept",
        ylabel="mean |azimuth error| [deg]",
        xlim=(0, 1),
        title=f"Risk and coverage, {result.estimator}, poses from {result.poses}, {len(result.links)} links",
    )
    axes.set_ylim(bottom=0)
    axes.grid(color="0.92")
    axes.legend(fontsize=8, loc="upper right")
    figure.savefig(path, dpi=130)
