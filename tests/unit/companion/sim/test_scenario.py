"""Scenario files are read strictly; the beacon drives when it should."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from companion.errors import ConfigError
from companion.sim.scenario import encode_scenario, load_scenario
from tests.sim_scenes import scene


def _written(folder: Path, change: dict[str, Any]) -> Path:
    document = json.loads(encode_scenario(scene()))
    for key, value in change.items():
        *parents, last = key.split(".")
        node = document
        for parent in parents:
            node = node[int(parent)] if isinstance(node, list) else node[parent]
        node[last] = value
    path = folder / "scenario.json"
    path.write_text(json.dumps(document))
    return path


def test_a_scenario_survives_its_file(tmp_path: Path) -> None:
    assert load_scenario(_written(tmp_path, {})) == scene()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"sede": 1}, "unknown keys: sede"),
        ({"radio.chanel": 108}, "unknown keys: radio.chanel"),
        ({"radio.reflectors.1.gian": 1}, r"unknown keys: radio.reflectors\[1\].gian"),
        ({"radio.channel": 6}, "radio.channel"),
        ({"uav.mac": "00:21"}, "uav.mac"),
        ({"uav.csi.path": ""}, "uav.csi.path: missing"),
        ({"beacon.csi.transport": "pipe"}, "beacon.csi.transport"),
    ],
)
def test_a_wrong_key_or_value_is_named(tmp_path: Path, change: dict[str, Any], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        load_scenario(_written(tmp_path, change))


def test_a_missing_or_broken_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.json: cannot read"):
        load_scenario(tmp_path / "none.json")
    (tmp_path / "half.json").write_text("{")
    with pytest.raises(ConfigError, match=r"half\.json"):
        load_scenario(tmp_path / "half.json")
