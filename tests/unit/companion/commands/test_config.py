"""`companion config`: checked, shown with its origins, printed from what is shipped."""

from __future__ import annotations

import json
from pathlib import Path

from click.testing import CliRunner, Result

from companion.cli import program
from companion.config.json_schema import json_schema
from companion.errors import ConfigError
from tests.paths import CONFIGS


def _run(*words: str) -> Result:
    return CliRunner().invoke(program, ["config", *words])


def test_check_names_the_robot_and_refuses_what_the_service_refuses(tmp_path: Path) -> None:
    for role in ("uav", "beacon"):
        text = (CONFIGS / f"{role}.yaml").read_text()
        (tmp_path / f"{role}.yaml").write_text(text.replace("/etc/companion/", "/no/such/folder/"))
    done = _run("check", str(tmp_path / "uav.yaml"), str(tmp_path / "beacon.yaml"))
    assert done.exit_code == 0
    assert done.stderr.count("there is no folder /no/such/folder here; not looked at") == 4
    assert [line.split(": ")[1] for line in done.stdout.splitlines()] == [
        "OK, role uav, robot 1 uav, peers 2 beacon",
        "OK, role beacon, robot 2 beacon, peers 1 uav",
    ]
    (tmp_path / "wrong.yaml").write_text("role: uav\n")
    refused = _run("check", str(tmp_path / "wrong.yaml"))
    assert isinstance(refused.exception, ConfigError) and "csi: missing" in str(refused.exception)


def test_show_says_where_each_value_came_from() -> None:
    path = CONFIGS / "uav.yaml"
    rows = dict(line.split(maxsplit=1) for line in _run("show", str(path)).output.splitlines())
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if text.startswith("  control:"))
    assert rows["mission.control"].split() == ['"observe"', f"{path}:{line}"]
    assert rows["mission.min_battery"].split() == ["0.2", "default"]
    assert rows["pose.lost_s"].split(maxsplit=1) == ["8.0", "default (with GPS)"]
    shown = {row["key"]: row for row in json.loads(_run("show", str(path), "--json").output)}
    assert shown["csi.channel"]["value"] == 108 and shown["csi.channel"]["where"].startswith(f"{path}:")


def test_an_example_is_printed_as_it_is_shipped() -> None:
    assert _run("example", "uav").output == (CONFIGS / "uav.yaml").read_text()
    assert _run("example", "gps").output == (CONFIGS / "px4" / "gps.params").read_text()
    assert {"uav", "beacon", "gps-denied", "companion.service"} <= set(_run("example").output.split())
    assert "no such example" in str(_run("example", "../uav").exception)


def test_the_keys_that_are_new_since_an_older_schema_are_named(tmp_path: Path) -> None:
    old = json_schema()
    del old["$defs"]["GateConfig"]["properties"]["max_climb_m_s"]
    old["properties"]["gone"] = {"type": "string"}
    (tmp_path / "old.json").write_text(json.dumps(old))
    assert _run("schema", "--since", str(tmp_path / "old.json")).output.splitlines() == [
        "new key gate.max_climb_m_s (default 0.7): a section",
        "key gone is no longer known: take it out of the configuration",
    ]
    (tmp_path / "none.json").write_text("[")
    assert isinstance(_run("schema", "--since", str(tmp_path / "none.json")).exception, ConfigError)
