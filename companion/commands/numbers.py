"""Numbers of the command line: finite, and within what they can mean."""

from __future__ import annotations

import math
from typing import Any

import click

from companion.config.places import LONGEST_LEVER_M
from companion.core.messages import Vector3

_LONGEST_S = 1e10
"""Between two clocks, both of which may count from 1970."""


class Number(click.FloatRange):
    """A FloatRange that refuses nan, which is neither below a bound nor above one."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a number.", param, ctx)
        return number


def offset_s(option: str, value: float | None) -> float:
    """Seconds between two clocks. Raises UsageError; `option` is shown as it was given, None is no number."""
    if value is None or not math.isfinite(value):
        raise click.UsageError(f"{option}: expected finite seconds")
    if abs(value) > _LONGEST_S:
        raise click.UsageError(f"{option}: expected seconds between two clocks, within 1e10")
    return value


def lever_m(option: str, values: tuple[float | None, ...]) -> Vector3:
    """Of an antenna, as `pose.antenna_m`. Raises UsageError."""
    if len(values) != 3 or not all(value is not None and math.isfinite(value) for value in values):
        form = ", F,L,U" if option.startswith("--tx-lever") else ""
        raise click.UsageError(f"{option}: expected three finite lengths in metres{form}")
    forward, left, up = (value for value in values if value is not None)
    if max(abs(forward), abs(left), abs(up)) > LONGEST_LEVER_M:
        raise click.UsageError(
            f"{option}: expected within {LONGEST_LEVER_M:g} m of the tracked point, in metres: a degree of attitude "
            "moves an antenna further out by more than half a wavelength"
        )
    return forward, left, up
