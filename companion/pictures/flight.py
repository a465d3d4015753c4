"""The picture of a flight from above: where both robots went and where each bearing pointed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

_BEARING_M = 1.6
_LEAST_SPAN_SHARE = 0.6  # of the longer side: a flight due East must not become a strip


@dataclass(frozen=True, slots=True)
class Arrow:
    """The bearing of one SAR iteration, from the place where it was taken."""

    iteration: int
    east_m: float
    north_m: float
    azimuth_rad: float


def draw_flight(
    path: Path,
    uav_m: npt.NDArray[np.float64],
    target_m: npt.NDArray[np.float64],
    bearings: Sequence[Arrow],
    title: str,
) -> None:
    """Writes a PNG. `uav_m` and `target_m` (N, 3) ENU."""
    figure, axes = plt.subplots(figsize=(8, 8), layout="constrained")
    axes.plot(uav_m[:, 0], uav_m[:, 1], color="tab:blue", linewidth=1.5, label="drone")
    axes.plot(target_m[:, 0], target_m[:, 1], color="tab:red", linewidth=2.5, label="ground robot")
    axes.plot(*uav_m[0, :2], "o", color="tab:blue", markersize=8, label="take-off")
    axes.plot(*target_m[0, :2], "s", color="tab:red", markersize=8, label="ground robot at the start")
    axes.plot(*target_m[-1, :2], "X", color="black", markersize=9, label="ground robot at the end")
    for bearing in bearings:
        east, north, azimuth = bearing.east_m, bearing.north_m, bearing.azimuth_rad
        axes.annotate(
            "",
            xy=(east + _BEARING_M * math.cos(azimuth), north + _BEARING_M * math.sin(azimuth)),
            xytext=(east, north),
            arrowprops={"arrowstyle": "->", "color": "tab:green", "linewidth": 1.4},
        )
        axes.annotate(str(bearing.iteration), (east, north), fontsize=7, color="0.3", ha="center", va="bottom")
    axes.plot([], [], color="tab:green", label="bearing of each SAR iteration")
    axes.set(xlabel="East [m]", ylabel="North [m]", title=title)
    axes.set_aspect("equal", adjustable="box")
    axes.grid(color="0.9")
    _widen(axes)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    figure.savefig(path, dpi=130, bbox_inches="tight")
    plt.close(figure)


def _widen(axes: Axes) -> None:
    """Gives the narrower side of the map a useful part of the wider one, about its own middle."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    least = _LEAST_SPAN_SHARE * max(east - west, north - south)
    for low, high, set_limits in ((west, east, axes.set_xlim), (south, north, axes.set_ylim)):
        if high - low < least:
            middle = (low + high) / 2
            set_limits(middle - least / 2, middle + least / 2)
