"""The picture of a flight from above: where both robots went and where each bearing pointed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

_BEARING_M = 1.6
_MOST_BEARINGS = 25  # apertures overlap: an arrow for each would hide the flight
_LEAST_SPAN_SHARE = 0.45  # of the longer side: a flight due East must not become a strip
_WIDTH_IN, _LEAST_IN, _MOST_IN = 8.0, 4.4, 7.0
_MARGINS_IN = (0.8, 1.4)  # what axes, title and legend take of the width and of the height


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
    *,
    title: str,
) -> None:
    """Writes a PNG. `uav_m` and `target_m` (N, 3) ENU."""
    figure = Figure(layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.plot(target_m[:, 0], target_m[:, 1], color="tab:red", linewidth=2.5, label="ground robot")
    axes.plot(uav_m[:, 0], uav_m[:, 1], color="tab:blue", linewidth=1.8, label="drone")
    axes.plot(*target_m[0, :2], "s", color="tab:red", markersize=8, label="ground robot at the start")
    axes.plot(*uav_m[0, :2], "o", color="tab:blue", markersize=8, label="take-off")
    _distance(axes, uav_m[-1], target_m[-1])
    for bearing in bearings[:: math.ceil(len(bearings) / _MOST_BEARINGS) or 1]:
        _bearing(axes, bearing)
    axes.plot([], [], color="tab:green", linewidth=1.8, label="bearings, with their SAR iterations' numbers")
    axes.set(xlabel="East [m]", ylabel="North [m]", title=title)
    axes.set_aspect("equal", adjustable="box")
    axes.grid(color="0.9")
    _widen(axes)
    _north(axes)
    figure.set_size_inches(_WIDTH_IN, _height_in(axes))
    figure.legend(loc="outside lower center", ncols=3, fontsize=10)
    figure.savefig(path, dpi=130, bbox_inches="tight")


def _bearing(axes: Axes, bearing: Arrow) -> None:
    """An arrow, and the iteration's number behind its tail, to the left."""
    east, north = bearing.east_m, bearing.north_m
    ahead = np.array([math.cos(bearing.azimuth_rad), math.sin(bearing.azimuth_rad)])
    left = np.array([-ahead[1], ahead[0]])
    axes.annotate(
        "",
        xy=(east + _BEARING_M * ahead[0], north + _BEARING_M * ahead[1]),
        xytext=(east, north),
        arrowprops={"arrowstyle": "-|>", "color": "tab:green", "linewidth": 1.8, "shrinkA": 0},
    )
    number = axes.annotate(
        str(bearing.iteration),
        (east, north),
        xytext=tuple(9 * left - 8 * ahead),
        textcoords="offset points",
        fontsize=9,
        ha="center",
        va="center",
    )
    number.set_path_effects([withStroke(linewidth=3, foreground="white")])


def _distance(axes: Axes, uav_m: npt.NDArray[np.float64], target_m: npt.NDArray[np.float64]) -> None:
    """How far apart both are at the end, in space."""
    apart_m = float(np.linalg.norm(uav_m - target_m))
    ends = np.stack([uav_m, target_m])
    label = f"at the end: {apart_m:.1f} m apart"
    axes.plot(ends[:, 0], ends[:, 1], "X--", color="black", markersize=9, linewidth=1.2, label=label)


def _north(axes: Axes) -> None:
    """Beside the map, where no path can be."""
    axes.annotate(
        "N",
        xy=(1.03, 1.0),
        xytext=(0, -48),
        xycoords="axes fraction",
        textcoords="offset points",
        fontsize=12,
        fontweight="bold",
        ha="center",
        va="center",
        annotation_clip=False,
        arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.8},
    )


def _height_in(axes: Axes) -> float:
    """Of the figure, so that the map fills it."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    across, beside = _MARGINS_IN
    return min(max((_WIDTH_IN - across) * (north - south) / (east - west) + beside, _LEAST_IN), _MOST_IN)


def _widen(axes: Axes) -> None:
    """Gives the narrower side of the map a useful part of the wider one, about its own middle."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    least = _LEAST_SPAN_SHARE * max(east - west, north - south)
    for low, high, set_limits in ((west, east, axes.set_xlim), (south, north, axes.set_ylim)):
        if high - low < least:
            middle = (low + high) / 2
            set_limits(middle - least / 2, middle + least / 2)
