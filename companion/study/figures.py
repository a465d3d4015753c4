"""Parts of pictures that several studies draw; readable without colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLES: tuple[Any, ...] = ("-", "--", ":", "-.", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "x")


def draw_cdf(axes: Axes, groups: Mapping[str, npt.ArrayLike], xlabel: str, limits: tuple[float, float] | None) -> None:
    """Share of values below each value, one line a group; values that are not finite never come below."""
    for number, (label, given) in enumerate(groups.items()):
        values = np.sort(np.asarray(given, float))
        finite = values[np.isfinite(values)]
        share = np.arange(1, finite.size + 1) / max(values.size, 1)
        axes.step(
            np.r_[finite[:1], finite],
            np.r_[[0.0] * min(finite.size, 1), share],
            where="post",
            linestyle=STYLES[number % len(STYLES)],
            label=label if finite.size else f"{label}: infinite everywhere",
        )
    axes.set(xlabel=xlabel, ylabel="share", ylim=(0, 1.02))
    if limits is not None:
        axes.set_xlim(*limits)
    axes.grid(color="0.92")
    axes.legend(fontsize=7, loc="lower right")


def draw_lines(
    axes: Axes, x: Sequence[float], groups: Mapping[str, Sequence[float]], xlabel: str, *, ylabel: str
) -> None:
    """One line with markers a group over common x."""
    for number, (label, y) in enumerate(groups.items()):
        axes.plot(x, y, linestyle=STYLES[number % len(STYLES)], marker=MARKERS[number % len(MARKERS)], label=label)
    axes.set(xlabel=xlabel, ylabel=ylabel)
    axes.grid(color="0.92")
    axes.legend(fontsize=7)
