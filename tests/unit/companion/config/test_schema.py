"""The types of the configuration: what holds for all of its keys."""

from __future__ import annotations

import contextlib
import dataclasses
import types
import typing
from collections.abc import Iterator
from typing import Any

import msgspec
import pytest

from companion.config.file import config_of, load_config
from companion.config.schema import CHECK, Config
from companion.errors import ConfigError
from tests.paths import CONFIGS

Path_ = tuple[str | int, ...]


def _numbers(cls: Any, path: Path_ = ()) -> Iterator[tuple[Path_, tuple[msgspec.Meta, ...]]]:
    """Where each number of a dataclass stands, with what is said of its type."""
    for name, hint in typing.get_type_hints(cls, include_extras=True).items():
        yield from _numbers_of(hint, (*path, name), ())


def _numbers_of(hint: Any, path: Path_, metas: tuple[msgspec.Meta, ...]) -> Iterator[Any]:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        yield from _numbers(hint, path)
    elif origin is typing.Annotated:
        yield from _numbers_of(arguments[0], path, arguments[1:])
    elif origin in (types.UnionType, typing.Union):
        for one in arguments:
            yield from _numbers_of(one, path, ())
    elif origin in (list, tuple):
        for number, one in enumerate(arguments):
            yield from _numbers_of(one, (*path, number), ())
    elif hint in (int, float):
        yield path, metas


_NUMBERS = dict(_numbers(Config))


def _set(document: Any, path: Path_, value: float) -> None:
    for key in path[:-1]:
        if isinstance(key, str) and document.get(key) is None:
            document[key] = {}
        if document == [] and path[:2] == ("tag_camera", "tags"):
            document.append({"peer": 2, "tag": 7, "size_m": 0.16})
        document = document[key]
    document[path[-1]] = value


def test_every_number_has_a_least_and_a_largest_value() -> None:
    bounds = {
        path: {name for meta in metas for name in ("ge", "gt", "le", "lt") if getattr(meta, name) is not None}
        for path, metas in _NUMBERS.items()
        if not any(CHECK in (meta.extra or {}) for meta in metas)
    }
    assert len(bounds) > 60
    assert {path for path, said in bounds.items() if not (said & {"ge", "gt"} and said & {"le", "lt"})} == set()
    assert [path for path, said in bounds.items() if "gt" in said] == []  # a number just above 0 is as wrong as 0


@pytest.mark.parametrize("role", ["uav", "beacon"])
@pytest.mark.parametrize("value", [0, -1, 1e-308, 1e308, -1e308, 2**63, 10**40, "least", "largest"])
def test_whatever_a_number_is_it_is_taken_or_refused_in_words(role: str, value: Any) -> None:
    shipped = load_config(CONFIGS / f"{role}.yaml")
    for path, metas in _NUMBERS.items():
        document = msgspec.json.decode(msgspec.json.encode(shipped))
        if document.get(str(path[0])) is None:
            continue
        bounds = {"least": "ge", "largest": "le"}
        found = [getattr(meta, bounds[value]) for meta in metas] if value in bounds else [value]
        _set(document, path, found[0] if found and found[0] is not None else 0)
        with contextlib.suppress(ConfigError):
            config_of(document, "here")
