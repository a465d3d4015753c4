"""Pictures of AOA profiles, in the manner of the paper: the profile from above and in 3D, the true bearing in it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from wsr.directions import Profile

_COLOURS: Final = "viridis"
_TRUTH_COLOUR: Final = "#e8000b"
_TRUTH_STYLE: Final = {"marker": "x", "markersize": 9, "markeredgewidth": 2.2, "linestyle": "none"}
_ESTIMATE_STYLE: Final = {"marker": "o", "markersize": 12, "markerfacecolor": "none", "linestyle": "none"}
_QUARTERS: Final = {-180: "West", -90: "South", 0: "East", 90: "North", 180: "West"}
_POOL: Final = 3
"""Grid points per facet of the 3D view, each way; the highest is shown."""

Floats = npt.NDArray[np.floating[Any]]
Found = tuple[float, float | None]
"""Azimuth and polar angle [rad], None where it is not observable."""


class HasDirection(Protocol):
    """An estimate, a peak: anything that has a direction."""

    @property
    def azimuth_rad(self) -> float: ...

    @property
    def polar_rad(self) -> float: ...


def draw_profile(
    path: Path,
    profile: Profile,
    estimate: HasDirection,
    truth: tuple[float, float] | None = None,
    *,
    title: str = "",
    azimuth_observable: bool = True,
    polar_observable: bool = True,
) -> None:
    """Writes a PNG: left the profile from above (azimuth, elevation), right in 3D, both relative to the peak.

    `truth` is the true azimuth and polar angle in radians, drawn as a red x; the estimate is a circle, or a line
    of one azimuth where the polar angle is not observable, and is called no bearing where the azimuth is not. Folders
    are made as needed. Raises OSError.
    """
    figure = Figure(figsize=(11.0, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    relative = profile.power / np.maximum(profile.power.max(), np.finfo(np.float32).tiny)
    found = (estimate.azimuth_rad, estimate.polar_rad if polar_observable else None)
    _top_view(figure, profile, relative, found, truth=truth)
    _view_3d(figure, profile, relative, found, truth=truth)
    figure.suptitle("\n".join(filter(None, (title, _summary(found, truth, azimuth_observable)))), fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def _top_view(
    figure: Figure,
    profile: Profile,
    relative: Floats,
    estimate: Found,
    *,
    truth: tuple[float, float] | None,
) -> None:
    axes: Axes = figure.add_subplot(1, 2, 1)
    azimuth_deg, up_deg = np.degrees(profile.azimuth_rad), _elevation_deg(profile.polar_rad)
    mesh = axes.pcolormesh(azimuth_deg, up_deg, relative, cmap=_COLOURS, vmin=0, vmax=1, shading="nearest")
    figure.colorbar(mesh, ax=axes, label="power / peak power", pad=0.01)
    azimuth_rad, polar_rad = estimate
    if polar_rad is None:
        axes.axvline(
            math.degrees(azimuth_rad), color="white", linewidth=1, linestyle="--", label="estimate (azimuth only)"
        )
    else:
        _mark(axes, (azimuth_rad, polar_rad), "white", "estimate", style=_ESTIMATE_STYLE)
    if truth is not None:
        _mark(axes, truth, _TRUTH_COLOUR, "true bearing", style=_TRUTH_STYLE)
    axes.legend(loc="lower right", fontsize=8, facecolor="#444444", labelcolor="white", framealpha=0.8)
    axes.axhline(0, color="white", linewidth=0.6, linestyle=":", alpha=0.7)
    axes.text(-176, 2, "horizon", color="white", fontsize=8, alpha=0.8)
    axes.set(xlabel="azimuth [deg], counter-clockwise from East", ylabel="elevation [deg]", title="top view")
    axes.set(xlim=(-180, 180), ylim=(-90, 90), yticks=range(-90, 91, 30))
    axes.set_xticks(list(_QUARTERS), [f"{azimuth_deg}\n{name}" for azimuth_deg, name in _QUARTERS.items()])


def _mark(axes: Axes, where: tuple[float, float], colour: str, label: str, *, style: dict[str, Any]) -> None:
    axes.plot(math.degrees(where[0]), _elevation_deg(where[1]), markeredgecolor=colour, label=label, **style)


def _view_3d(
    figure: Figure,
    profile: Profile,
    relative: Floats,
    estimate: Found,
    *,
    truth: tuple[float, float] | None,
) -> None:
    axes: Any = figure.add_subplot(1, 2, 2, projection="3d", computed_zorder=False)
    x, y = np.meshgrid(
        np.degrees(profile.azimuth_rad)[_POOL // 2 :: _POOL], _elevation_deg(profile.polar_rad)[_POOL // 2 :: _POOL]
    )
    axes.plot_surface(
        x, y, _pooled(relative), cmap=_COLOURS, vmin=0, vmax=1, rstride=1, cstride=1, linewidth=0, antialiased=False
    )
    azimuth_rad, polar_rad = estimate
    if polar_rad is None:
        _ridge(axes, profile, relative, azimuth_rad)
    else:
        _stem(axes, profile, relative, (azimuth_rad, polar_rad), colour="black", style=_ESTIMATE_STYLE)
    if truth is not None:
        _stem(axes, profile, relative, truth, colour=_TRUTH_COLOUR, style=_TRUTH_STYLE)
    axes.set(xlabel="azimuth [deg]", ylabel="elevation [deg]", title="3D view")
    axes.set(xlim=(-180, 180), ylim=(-90, 90), zlim=(0, 1.1))
    axes.set(xticks=range(-180, 181, 90), yticks=range(-90, 91, 45), zticks=(0, 0.5, 1))
    axes.view_init(elev=35, azim=-65)
    axes.set_box_aspect((1.7, 1.2, 0.85), zoom=1.15)


def _ridge(axes: Any, profile: Profile, relative: Floats, azimuth_rad: float) -> None:
    """A line over the surface at all elevations of one azimuth."""
    column = int(np.argmax(np.cos(profile.azimuth_rad - azimuth_rad)))
    azimuth_deg = np.full(len(profile.polar_rad), math.degrees(azimuth_rad))
    heights = relative[:, column] + 0.03
    axes.plot(azimuth_deg, _elevation_deg(profile.polar_rad), heights, color="black", linewidth=0.9, zorder=10)


def _stem(
    axes: Any,
    profile: Profile,
    relative: Floats,
    where: tuple[float, float],
    *,
    colour: str,
    style: dict[str, Any],
) -> None:
    """A line up from the ground with the mark above the surface, so that a direction in a valley is seen too."""
    azimuth_deg, up_deg = math.degrees(where[0]), _elevation_deg(where[1])
    column = int(np.argmax(np.cos(profile.azimuth_rad - where[0])))
    row = int(np.argmin(np.abs(profile.polar_rad - where[1])))
    height = float(relative[row, column]) + 0.06
    axes.plot([azimuth_deg] * 2, [up_deg] * 2, [0, height], color=colour, linewidth=0.9, zorder=10)
    axes.plot([azimuth_deg], [up_deg], [height], markeredgecolor=colour, zorder=11, **style)


def _pooled(relative: Floats) -> Floats:
    """The highest of each _POOL x _POOL block: a plain subset of the grid would miss narrow peaks."""
    rows, columns = (size // _POOL for size in relative.shape)
    blocks = relative[: rows * _POOL, : columns * _POOL].reshape(rows, _POOL, columns, _POOL)
    return np.asarray(blocks.max(axis=(1, 3)))


def _summary(estimate: Found, truth: tuple[float, float] | None, azimuth_observable: bool) -> str:
    azimuth_rad, polar_rad = estimate
    up = "" if polar_rad is None else f", elevation {_elevation_deg(polar_rad):.1f}°"
    name = "estimate" if azimuth_observable else "highest peak, not a bearing"
    text = f"{name}: azimuth {math.degrees(azimuth_rad):.1f}°{up}"
    if truth is None:
        return text
    return f"{text}   true: {math.degrees(truth[0]):.1f}°, {_elevation_deg(truth[1]):.1f}°"


def _elevation_deg(polar_rad: Any) -> Any:
    """Above the horizon: the one vertical angle that a person is shown. Of one angle or of an array."""
    return 90.0 - np.degrees(polar_rad)
