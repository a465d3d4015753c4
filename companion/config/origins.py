"""Where each value of a configuration came from: a line of its file, or the default."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import yaml

from companion.config.schema import Config


@dataclass(frozen=True, slots=True)
class ValueOrigin:
    """One effective value. `line` is None where the file does not state it."""

    key: str
    """For example `peers[0].mac`."""
    value: Any
    line: int | None
    why: str = ""
    """What a default was derived from, where it is none of the schema's own."""


def origins(config: Config, text: str) -> Iterator[ValueOrigin]:
    """Every value of `config` in the order of the schema; `text` is the file that it was read from."""
    node = yaml.compose(text, Loader=yaml.SafeLoader)
    lines = {} if node is None else dict(_lines(node, ""))
    for key, value in _leaves(config, ""):
        derived, why = _derived(config, key) if value is None else (None, "")
        yield ValueOrigin(key, value if derived is None else derived, lines.get(key), why)


def _derived(config: Config, key: str) -> tuple[Any, str]:
    """What an absent value means, where that is another one's consequence."""
    if key == "pose.drift":
        return config.pose_drift, f"of source {config.pose.source}"
    if key == "pose.lost_s":
        return config.pose_lost_s, "without GPS" if config.flies_by_poses else "with GPS"
    if key == "mission.target" and config.peers:
        return config.target, "the first of peers"
    return None, ""


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            yield from _leaves(getattr(value, field.name), f"{path}.{field.name}" if path else field.name)
    elif isinstance(value, list) and value and dataclasses.is_dataclass(value[0]):
        for index, item in enumerate(value):
            yield from _leaves(item, f"{path}[{index}]")
    else:
        yield path, value


def _lines(node: yaml.Node, path: str) -> Iterator[tuple[str, int]]:
    """Path and line of every value below `node`."""
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            below = f"{path}.{key.value}" if path else key.value
            yield below, key.start_mark.line + 1
            yield from _lines(value, below)
    elif isinstance(node, yaml.SequenceNode):
        for index, item in enumerate(node.value):
            yield f"{path}[{index}]", item.start_mark.line + 1
            yield from _lines(item, f"{path}[{index}]")
