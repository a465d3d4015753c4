"""The pictures of a report. Everything is told apart by marks, lines and shades of grey: pages are printed."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from companion.analysis.exchanges import PacketTimes
from companion.core.streams import CSI, NEIGHBOUR, POSE_IN, SETPOINT
from companion.log.times import bin_edges_s, main_span_ns
from companion.page.parts import elevation_deg
from companion.report.content import FlightContent

_DPI: Final = 90
_BEARING_M: Final = 1.6
_COLUMNS: Final = 4
_TILE_DEG: Final = (400.0, 235.0)
"""From one to the next, across and down."""
_STEP_S: Final = 60.0
"""Nobody is silent for so long in a recording: the clock was set."""

_LINES: Final = tuple(itertools.product(("0.0", "0.6"), ("-", "--", ":", "-.")))
"""Shade and style, told apart in print."""

Direction = tuple[float, float | None]
"""Azimuth and polar angle [rad], None where it is not observable."""


def flight_path(content: FlightContent) -> bytes:
    """From above: the vehicle by its autopilot, a bearing at each reference point, darker the later; PNG."""
    figure, (axes,) = _figure(7.5, 6.5)
    if content.vehicle_m:
        place = np.array(content.vehicle_m)
        axes.plot(place[:, 0], place[:, 1], "k-", linewidth=1.0, label="vehicle (autopilot)")
        axes.plot(*place[0, :2], "ko", label="first position")
    with_bearing = [one for one in content.iterations if one.estimate is not None and one.p_local_enu_m is not None]
    for index, one in enumerate(with_bearing):
        assert one.estimate is not None
        assert one.p_local_enu_m is not None
        east, north, _ = one.p_local_enu_m
        angle = one.estimate.azimuth_rad
        shade = str(0.7 - 0.7 * (index + 1) / len(with_bearing))
        style = "-" if one.estimate.azimuth_observable else ":"
        tip = (east + _BEARING_M * math.cos(angle), north + _BEARING_M * math.sin(angle))
        arrow = {"arrowstyle": "->", "color": shade, "linestyle": style}
        axes.annotate("", xy=tip, xytext=(east, north), arrowprops=arrow)
        axes.annotate(str(one.number), (east, north), fontsize=7, color="0.3", ha="center", va="bottom")
    axes.plot([], [], "-", color="0.3", label="bearing of each SAR iteration, darker the later")
    if content.truth:
        _plot_truth(axes, content)
    axes.set(xlabel="East [m]", ylabel="North [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=8, loc="upper right")
    return _png(figure)


def profiles(
    tiles: Sequence[tuple[str, npt.NDArray[np.floating[Any]], Direction, tuple[float, float] | None]],
) -> bytes:
    """Small multiples: each (title, power, estimate, truth), dark where the power is high; PNG."""
    rows = max(1, math.ceil(len(tiles) / _COLUMNS))
    figure = Figure(figsize=(11, 2.1 * rows + 0.5), layout="constrained")
    FigureCanvasAgg(figure)
    # One pair of axes for all: a pair for each, with ticks and a layout of their own, takes seconds.
    axes = figure.add_subplot()
    frames = []
    for index, (title, power, (azimuth, polar), truth) in enumerate(tiles):
        row, column = divmod(index, _COLUMNS)
        x, y = column * _TILE_DEG[0], -row * _TILE_DEG[1]
        extent = (x - 180.0, x + 180.0, y - 90.0, y + 90.0)
        axes.imshow(power / max(float(power.max()), 1e-30), cmap="gray_r", vmin=0, vmax=1, extent=extent, aspect="auto")
        axes.text(x, y + 94.0, title, fontsize=8, ha="center", va="bottom")
        frames.append([(extent[side], extent[end]) for side, end in ((0, 2), (1, 2), (1, 3), (0, 3), (0, 2))])
        if polar is None:
            axes.plot([x + math.degrees(azimuth)] * 2, extent[2:], color="black", linestyle="--", linewidth=0.8)
        else:
            # A ring around the peak, wide enough to see the peak and the truth in it.
            axes.plot(x + math.degrees(azimuth), y + elevation_deg(polar), "ko", markersize=15, fillstyle="none")
        if truth is not None:
            place = x + math.degrees(truth[0]), y + elevation_deg(truth[1])
            axes.plot(*place, "wx", markersize=6, markeredgewidth=2.5)
            axes.plot(*place, "kx", markersize=6, markeredgewidth=1.0)
    axes.add_collection(LineCollection(frames, colors="black", linewidths=0.8))
    columns = range(min(len(tiles), _COLUMNS))
    across = up = -90, 0, 90
    axes.set_xticks([c * _TILE_DEG[0] + a for c in columns for a in across], [str(a) for _ in columns for a in across])
    axes.set_yticks([-r * _TILE_DEG[1] + u for r in range(rows) for u in up], [str(u) for _ in range(rows) for u in up])
    axes.set(xlim=(-190.0, (len(columns) - 1) * _TILE_DEG[0] + 190.0))
    axes.set(ylim=(-(rows - 1) * _TILE_DEG[1] - 100.0, 130.0))
    axes.tick_params(labelsize=6)
    axes.spines[:].set_visible(False)
    return _png(figure)


def estimates(content: FlightContent) -> bytes:
    """Error against the truth where there is one, with the Cramer-Rao bound; reliability; PNG."""
    figure, (above, below) = _figure(9, 5.5, 2)
    with_estimate = [one for one in content.iterations if one.estimate is not None]
    t_s = [content.seconds(one.reference_ns) for one in with_estimate]
    bound = [one.estimate.crb_rad for one in with_estimate if one.estimate is not None]
    above.plot(t_s, [math.nan if b is None else math.degrees(b) for b in bound], "s--", color="0.5", label="CRB")
    if content.truth:
        above.plot(t_s, error_degrees(content), "ko-", label="error (great circle)")
    above.set(
        ylabel="[deg]", yscale="log", title="error and bound" if content.truth else "bound (no truth in this log)"
    )
    above.legend(fontsize=8, loc="upper right")
    reliability = [one.estimate.reliability for one in with_estimate if one.estimate is not None]
    below.plot(t_s, reliability, "ko-")
    below.axhline(content.config.aperture.min_reliability, color="0.5", linestyle=":", label="least that steers")
    below.set(ylabel="reliability", ylim=(0, 1), xlabel="time [s]")
    below.legend(fontsize=8, loc="upper right")
    return _png(figure)


def distance(content: FlightContent) -> bytes:
    """To the target over time: as it is where the truth knows, and as the flight believed, with one deviation; PNG."""
    figure, (axes,) = _figure(9, 3.2)
    known = [(t_s, one["target"]) for t_s, one in content.targets if one["target"]["range_m"] is not None]
    if known:
        t_s = np.array([t for t, _ in known])
        range_m = np.array([target["range_m"] for _, target in known])
        std_m = np.array([_number(target["range_std_m"]) for _, target in known])
        axes.fill_between(t_s, np.maximum(0, range_m - std_m), range_m + std_m, color="0.85", label="one deviation")
        axes.plot(t_s, range_m, "k--", label="believed")
    if true := content.true_distances():
        axes.plot([t for t, _ in true], [d for _, d in true], "k-", label="true")
    if known or true:
        axes.legend(fontsize=8, loc="upper right")
        axes.set_ylim(0, 1.1 * max([d for _, d in true] + [target["range_m"] for _, target in known]))
    axes.set(ylabel="distance [m]", xlabel="time [s]", title="distance to the target")
    return _png(figure)


def rates(content: FlightContent) -> bytes:
    """Packets, poses, datagrams and set points a second, and how many packets of each iteration were paired; PNG."""
    figure, (packets, pairs, points) = _figure(9, 7, 3)
    for stream, style in ((CSI, "k-"), (POSE_IN, "k--"), (NEIGHBOUR, "k:")):
        packets.plot(*content.rate(stream.topic), style, label=stream.topic)
    packets.set(ylabel="messages/s", title="what was heard")
    packets.legend(fontsize=8, loc="upper right")
    t_s = [content.seconds(one.reference_ns) for one in content.iterations]
    used = [one.estimate.packets if one.estimate is not None else 0 for one in content.iterations]
    share = [100 * count / max(one.received, 1) for count, one in zip(used, content.iterations, strict=True)]
    pairs.bar(t_s, share, width=1.0, color="0.7", edgecolor="k")
    pairs.set(ylabel="of packets [%]", ylim=(0, 105), title="paired and used in each SAR iteration")
    points.plot(*content.rate(SETPOINT.topic), "k-")
    points.set(ylabel="messages/s", xlabel="time [s]", title="set points")
    return _png(figure)


def health(content: FlightContent) -> bytes:
    """Ages of poses and neighbours, what was lost and dropped, and the mission's state; PNG."""
    figure, (ages, losses, states) = _figure(9, 7, 3)
    t_s = [t for t, _ in content.health]
    ages.plot(t_s, [_number(values.get("pose_age_s")) for _, values in content.health], "k-", label="pose age")
    names = sorted({name for _, values in content.health for name in values.get("neighbours", {})})
    for name, style in zip(names, ("k--", "k:", "k-."), strict=False):
        heard = [_number(values["neighbours"].get(name, {}).get("age_s")) for _, values in content.health]
        ages.plot(t_s, heard, style, label=f"datagram of {name}")
    ages.set(ylabel="age [s]", title="freshness")
    ages.legend(fontsize=8, loc="upper right")
    for group, key, style in (("radio", "lost", "k-"), ("radio", "malformed", "k--"), ("recorder", "dropped", "k:")):
        counted = [_number(values.get(group, {}).get(key)) for _, values in content.health]
        losses.plot(t_s, counted, style, label=f"{group}: {key}")
    losses.set(ylabel="count", title="lost, malformed and dropped since the start")
    losses.legend(fontsize=8, loc="upper right")
    _state_line(states, content)
    return _png(figure)


def error_degrees(content: FlightContent) -> list[float]:
    """Of each estimate, as `TruthTrack.error_deg` has them; not a number where the truth does not know."""
    errors = []
    for one in content.iterations:
        if one.estimate is None:
            continue
        error = content.truth.error_deg(one.reference_ns, content.peer_name(one.peer), one.estimate)
        errors.append(math.nan if error is None else error)
    return errors


def path_of(p_m: npt.NDArray[np.float64], bearings: Sequence[tuple[str, float]]) -> bytes:
    """The path of a recording from above with one bearing a transmitter (name, azimuth [rad]); PNG."""
    figure, (axes,) = _figure(6, 5.5)
    axes.plot(p_m[:, 0], p_m[:, 1], "k-", linewidth=1.0, label="receiving robot")
    axes.plot(*p_m[0, :2], "ko", label="start")
    x, y = p_m[:, :2].mean(axis=0).tolist()
    length = max(1.0, 1.5 * float(np.ptp(p_m[:, :2], axis=0).max()))
    for name, azimuth in bearings:
        tip = (x + length * math.cos(azimuth), y + length * math.sin(azimuth))
        axes.annotate("", xy=tip, xytext=(x, y), arrowprops={"arrowstyle": "->", "color": "0.3"})
        axes.annotate(name, tip, fontsize=9)
        axes.plot(*tip, alpha=0)
    axes.set(xlabel="East [m]", ylabel="North [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=8, loc="upper right")
    return _png(figure)


def recording_rates(links: Sequence[tuple[str, PacketTimes]]) -> bytes:
    """Of each transmitter of a recording (name, its packets' times), in each second: packets heard, and which share of
    them was paired, and used for its aperture; PNG. Where the host's clock was set meanwhile, of the longer part."""
    figure, (packets, pairs, used) = _figure(9, 7, 3)
    heard_s = _without_steps(np.concatenate([times.heard_s for _, times in links]))
    heard_s = _of_one_time(heard_s)
    edges_s = heard_s[0] + bin_edges_s(np.ptp(heard_s))
    for (name, times), (shade, style) in zip(links, itertools.cycle(_LINES), strict=False):
        counts = [np.histogram(t_s, edges_s)[0] for t_s in (times.heard_s, times.paired_s, times.used_s)]
        of_heard = 100 / np.where(counts[0] > 0, counts[0], math.nan)
        lines = counts[0], counts[1] * of_heard, counts[2] * of_heard
        for axes, values in zip((packets, pairs, used), lines, strict=True):
            axes.plot(edges_s[:-1] - edges_s[0], values, style, color=shade, label=name)
    packets.set(ylabel="packets/s", ylim=(0, 1.1 * packets.dataLim.y1), title="what was heard")
    packets.legend(fontsize=8, loc="upper right")
    pairs.set(ylabel="of packets [%]", ylim=(0, 105), title="paired")
    used.set(ylabel="of packets [%]", ylim=(0, 105), xlabel="time [s]", title="used: paired, while there were poses")
    return _png(figure)


def _of_one_time(t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Without what is of another time altogether, of a clock that was not set."""
    span_ns = main_span_ns((np.maximum(t_s, 0) * 1e9).astype(np.uint64).tolist())
    if span_ns is None:
        return t_s
    return t_s[(t_s * 1e9 >= span_ns[0] - 1e3) & (t_s * 1e9 <= span_ns[1] + 1e3)]


def _without_steps(t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Sorted; of times (N,) [s] minutes apart those that are the most."""
    in_order = np.sort(t_s)
    return max(np.split(in_order, np.flatnonzero(np.diff(in_order) > _STEP_S) + 1), key=len)


def _plot_truth(axes: Axes, content: FlightContent) -> None:
    """The truth has an origin of its own: it is moved so that the vehicle's true and estimated places agree."""
    t_s = (content.truth.t_ns + content.session.wall_minus_mono_ns - content.start_ns) / 1e9
    shift = np.zeros(3)
    if content.vehicle_m:
        at = np.array(content.vehicle_t_s)
        seen = np.stack([np.interp(at, t_s, content.truth.antenna_m[:, axis]) for axis in range(3)], axis=1)
        shift = np.median(np.array(content.vehicle_m) - seen, axis=0)
    for name, p_m in content.truth.peers_m.items():
        moved = p_m + shift
        axes.plot(moved[:, 0], moved[:, 1], "-", color="0.6", linewidth=3, label=f"{name} (truth)")
        axes.plot(*moved[-1, :2], "kX", markersize=8)


def _state_line(axes: Axes, content: FlightContent) -> None:
    names = list(dict.fromkeys(["idle", *(state for _, state in content.states)]))
    t_s = [0.0, *(t for t, _ in content.states), content.duration_s]
    levels = [names.index(state) for state in ("idle", *(state for _, state in content.states))]
    axes.step(t_s, [*levels, levels[-1]], "k-", where="post")
    axes.set_yticks(range(len(names)), names)
    axes.set(xlabel="time [s]", title="mission")


def _figure(width: float, height: float, rows: int = 1) -> tuple[Figure, tuple[Axes, ...]]:
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    panels = tuple(np.ravel(figure.subplots(rows, 1, sharex=rows > 1)))
    for panel in panels:
        panel.grid(color="0.9")
    return figure, panels


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None})
    return buffer.getvalue()


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
