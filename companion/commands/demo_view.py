"""What a person sees of the demo: a live table while it runs, one row for each SAR iteration at the end."""

from __future__ import annotations

import math
from types import TracebackType

from rich.live import Live
from rich.table import Table
from rich.text import Text

from companion.commands.terminal import Console
from companion.sim.demo import Watch
from companion.sim.demo_rows import DemoResult, Row
from wsr.geometry import angles, direction, great_circle

_PLAIN_EVERY_S = 5.0
_NONE = "-"


class LiveTable:
    """A context that shows each `Watch`: in place on a terminal, a line now and then elsewhere."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._live = Live(console=console, refresh_per_second=4, transient=True) if console.is_terminal else None
        self._next_line_s = 0.0

    def __enter__(self) -> LiveTable:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, watch: Watch) -> None:
        cells = _cells(watch)
        if self._live is not None:
            self._live.update(_table(cells))
        elif watch.elapsed_s >= self._next_line_s:
            self._next_line_s = watch.elapsed_s + _PLAIN_EVERY_S
            self._console.print("  ".join(f"{name} {value}" for name, value in cells.items()), highlight=False)


def rows_table(rows: list[Row]) -> Table:
    """One line per SAR iteration; azimuth counter-clockwise from East, elevation above the horizon."""
    # As Text: in a plain string rich would take what stands in brackets for markup, and drop it.
    title = "SAR iterations [m, deg]: azimuth from East, elevation above the horizon, error as a great circle;"
    table = Table(title=Text(f"{title} the CRB is of noise alone, without reflections and drift"), padding=0)
    headings = (
        "#",
        "t\n[s]",
        "pac-\nkets",
        "aper-\nture",
        "azi-\nmuth",
        "true",
        "ele-\nvation",
        "true",
        "error",
        "CRB",
    )
    for heading in (*headings, "reli-\nability", "dis-\ntance"):
        table.add_column(Text(heading), justify="right", no_wrap=True)
    for row in rows:
        table.add_row(
            str(row.iteration),
            f"{row.time_s:.1f}",
            str(row.packets),
            _number(row.length_m, 2),
            _number(row.azimuth_deg, 1),
            f"{row.true_azimuth_deg:.1f}",
            _number(row.elevation_deg, 1),
            f"{row.true_elevation_deg:.1f}",
            _number(row.error_deg, 2),
            _number(row.crb_deg, 3),
            _number(row.reliability, 2),
            f"{row.distance_m:.2f}",
        )
    return table


def summary_lines(result: DemoResult) -> list[str]:
    """The figures of the run in words."""
    estimated = sum(row.error_deg is not None for row in result.rows)
    mean = "none" if result.mean_error_deg is None else f"{result.mean_error_deg:.2f} deg"
    return [
        f"{'reached' if result.reached else 'NOT reached'}: {result.outcome}, {result.flight_s:.0f} s after engaging",
        f"mean AOA error over {estimated} of {len(result.rows)} SAR iterations (great circle): {mean}",
        f"set points in offboard flight: {result.mean_setpoint_rate_hz:.1f}/s, in the worst second "
        f"{result.lowest_setpoint_rate_hz:.0f}; before it, to be let in: "
        f"{result.setpoints_before_offboard}; after it: {result.setpoints_after_offboard}",
        *(f"iteration {row.iteration} refused: {row.refusal}" for row in result.rows if row.refusal),
    ]


def _cells(watch: Watch) -> dict[str, str]:
    status = watch.status
    bearing = status.get("bearing")
    cells = {
        "t": f"{watch.elapsed_s:5.1f} s",
        "phase": str(status.get("state", _NONE)),
        "packets": str(status.get("packets", _NONE)),
        "bearing": _NONE,
        "error": _NONE,
        "set points": f"{watch.setpoint_rate_hz:4.1f}/s",
        "distance": _NONE if watch.truth is None else f"{watch.truth.distance_m:5.2f} m",
    }
    if bearing is not None:
        cells["bearing"] = f"{bearing['azimuth_deg']:6.1f} / {bearing['elevation_deg']:5.1f} deg"
        cells["error"] = _error_now(watch, bearing)
    return cells


def _error_now(watch: Watch, bearing: dict[str, float]) -> str:
    """Against the truth at the bearing's own reference time."""
    then = watch.bearing_truth
    if then is None:
        return _NONE
    true = [b - u for b, u in zip(then.beacon_antenna_enu_m, then.uav_antenna_enu_m, strict=True)]
    found = direction(math.radians(bearing["azimuth_deg"]), math.radians(90.0 - bearing["elevation_deg"]))
    return f"{math.degrees(float(great_circle(found, direction(*angles(true))))):4.1f} deg"


def _table(cells: dict[str, str]) -> Table:
    table = Table(padding=0)
    for name in cells:
        table.add_column(name, justify="right", no_wrap=True)
    table.add_row(*cells.values())
    return table


def _number(value: float | None, digits: int) -> str:
    return _NONE if value is None else f"{value:.{digits}f}"
