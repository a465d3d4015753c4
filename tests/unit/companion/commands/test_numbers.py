"""Numbers of the command line that no option can mean."""

from __future__ import annotations

import importlib

import click
import pytest

from companion.cli import _COMMANDS, _MODULES
from companion.commands.numbers import Number, lever_m, offset_s


def _options(command: click.Command) -> list[click.Parameter]:
    below = command.commands.values() if isinstance(command, click.Group) else []
    return [*command.params, *(param for one in below for param in _options(one))]


def _of_all() -> dict[str, click.Parameter]:
    commands = {
        name: getattr(importlib.import_module(f"companion.commands.{_MODULES.get(name, name)}"), name.replace("-", "_"))
        for name in _COMMANDS
    }
    return {f"{name} {param.name}": param for name, one in commands.items() for param in _options(one)}


def test_every_range_of_floats_refuses_what_is_no_number() -> None:
    ranges = {name: param.type for name, param in _of_all().items() if isinstance(param.type, click.FloatRange)}
    assert len(ranges) >= 5
    assert {name for name, kind in ranges.items() if not isinstance(kind, Number)} == set()
    assert {name for name, kind in ranges.items() if kind.min is None or kind.max is None} == set()


def test_a_float_without_a_range_is_looked_at_by_its_command() -> None:
    plain = {name for name, param in _of_all().items() if param.type is click.FLOAT}
    assert plain == {"analyze time_offset", "log time_offset"}


@pytest.mark.parametrize("text", ["nan", "inf", "-inf", "1e400", "-1", "1.5"])
def test_what_is_outside_is_refused(text: str) -> None:
    with pytest.raises(click.BadParameter):
        Number(0, 1).convert(text, None, None)
    assert Number(0, 1).convert("0.5", None, None) == 0.5


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e308, -1e11, None])
def test_an_offset_is_between_two_clocks(value: float | None) -> None:
    with pytest.raises(click.UsageError, match="--x 5: expected"):
        offset_s("--x 5", value)
    assert offset_s("--x", -1.7e9) == -1.7e9


@pytest.mark.parametrize(
    "values", [(0.0, 2.1, 0.0), (0.0, 0.0, -1e308), (0.0, float("nan"), 0.0), (0.0, 0.0), (None,) * 3]
)
def test_a_lever_is_as_long_as_a_robot(values: tuple[float | None, ...]) -> None:
    with pytest.raises(click.UsageError, match="--lever: expected"):
        lever_m("--lever", values)
    assert lever_m("--lever", (0.0, -2.0, 2.0)) == (0.0, -2.0, 2.0)
