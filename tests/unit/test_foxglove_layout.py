"""The layout for Foxglove names streams and fields that a log has."""

from __future__ import annotations

import json
import typing
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

from companion.core.messages import VehicleState
from companion.core.streams import STREAMS
from companion.flight.records import MissionStep
from companion.guidance.target import TargetReport
from companion.roles.health import Health
from companion.sensing.records import Iteration
from tests.paths import CONFIGS

_KINDS = {"/bearing": Iteration, "/target": TargetReport, "/mission": MissionStep, "/vehicle": VehicleState}
_KINDS |= {"/health": Health}
_LAYOUT: dict[str, Any] = json.loads((CONFIGS / "foxglove-layout.json").read_text())


def test_every_panel_that_is_laid_out_is_configured() -> None:
    assert set(_panels(_LAYOUT["layout"])) == set(_LAYOUT["configById"])


def test_every_topic_is_a_stream_and_every_field_is_in_its_messages() -> None:
    topics = {stream.topic for stream in STREAMS}
    paths = list(_paths())
    assert len(paths) > 10
    for path in paths:
        topic, *names = path.split(".")
        assert topic in topics, path
        kind: Any = _KINDS.get(topic)
        for name in names:
            assert is_dataclass(kind), path
            assert name in {one.name for one in fields(kind)}, path
            hint = typing.get_type_hints(kind)[name]
            kind = next((one for one in (hint, *typing.get_args(hint)) if is_dataclass(one)), None)
            if kind is None:
                break  # a plain value, or a mapping of counters


def _panels(node: Any) -> Iterator[str]:
    if isinstance(node, str):
        yield node
    else:
        yield from _panels(node["first"])
        yield from _panels(node["second"])


def _paths() -> Iterator[str]:
    for panel in _LAYOUT["configById"].values():
        yield from (one["value"] for one in panel.get("paths", ()))
        yield from panel.get("topics", ())
        yield from (panel[key] for key in ("topicPath", "topicToRender") if key in panel)
