"""The schema for editors: the shipped file is the one that the program makes, and it takes what the service takes."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from typing import Any

import fastjsonschema
import pytest

from companion.config.document import read_document
from companion.config.json_schema import json_schema, keys_of
from tests.paths import CONFIGS

_EXAMPLES = sorted(CONFIGS.glob("*.yaml"))
_FILE = CONFIGS / "companion.schema.json"


@functools.cache
def _validator() -> Callable[[Any], Any]:
    return fastjsonschema.compile(json_schema())


def _validate(document: Any) -> None:
    _validator()(document)


@pytest.mark.parametrize("path", _EXAMPLES, ids=lambda path: path.name)
def test_an_example_names_the_schema_and_fits_it(path: Any) -> None:
    text = path.read_text()
    assert text.splitlines()[0] == f"# yaml-language-server: $schema={_FILE.name}"
    _validate(read_document(text, path.name))


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("csi", "channel", 7),
        ("csi", "sorce", "netlink"),
        ("mission", "control", "flyy"),
        ("mission", "speed_m_s", 3.0),
        ("pose", "antenna_m", [0.0, 0.0]),
        ("autopilot", "origin_deg", "here"),
    ],
)
def test_what_the_service_refuses_is_marked(section: str, key: str, value: object) -> None:
    document = read_document((CONFIGS / "demo-uav.yaml").read_text(), "demo-uav.yaml")
    document[section][key] = value
    with pytest.raises(fastjsonschema.JsonSchemaException):
        _validate(document)


def test_the_shipped_schema_is_of_this_program() -> None:
    assert json.loads(_FILE.read_text()) == json_schema(), "companion config schema > configs/companion.schema.json"


def test_every_key_of_every_section_is_known_with_its_meaning() -> None:
    keys = keys_of(json_schema())
    assert {"role", "peers[].mac", "pose.natnet.port", "autopilot.url", "gate.max_speed_m_s"} <= keys.keys()
    assert keys["pose.min_confidence"]["description"].startswith("An aperture with poses below this")
    assert 108 in keys["csi.channel"]["enum"] and 7 not in keys["csi.channel"]["enum"]
