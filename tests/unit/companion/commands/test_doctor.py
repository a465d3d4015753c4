"""`companion doctor all`: every part one after the other, as text and as JSON, with one exit code."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

from click.testing import CliRunner

from companion.cli import program
from companion.config.file import load_config, save_config
from companion.config.schema import AutopilotConfig
from companion.errors import CompanionError
from companion.neighbours.keys import write_key
from companion.sim.stage import free_udp_port
from tests.paths import CONFIGS


def test_all_parts_are_looked_at_and_what_is_wrong_is_named(tmp_path: Path) -> None:
    config = load_config(CONFIGS / "demo-uav.yaml")
    config = dataclasses.replace(
        config,
        runtime_dir=str(tmp_path),
        csi=dataclasses.replace(config.csi, source="unix"),
        neighbours=dataclasses.replace(config.neighbours, port=free_udp_port("127.255.255.255")),
        autopilot=AutopilotConfig("serial:///dev/ttyNONE0:921600"),
    )
    save_config(config, tmp_path / "uav.yaml")
    for name in ("uav.key", "beacon.key"):
        write_key(tmp_path / name)
    words = ["doctor", "all", "--config", str(tmp_path / "uav.yaml"), "--seconds", "0.5"]
    done = CliRunner().invoke(program, [*words, "--json", str(tmp_path / "all.json")])
    assert isinstance(done.exception, CompanionError) and done.exception.exit_code == 1
    told = json.loads((tmp_path / "all.json").read_text())
    assert list(dict.fromkeys(check["part"] for check in told)) == ["system", "radio", "camera", "autopilot"]
    wrong = {check["name"] for check in told if check["ok"] is False}
    assert {"vehicle", "counters", "camera"} <= wrong
    assert {"own key", "key of beacon", "packages", "robots' network"} & wrong == set()
    lines = done.output.splitlines()
    assert "autopilot:" in lines and any("there is no device /dev/ttyNONE0" in line for line in lines)
    assert all(check["remedy"] or check["found"] for check in told)


def test_a_beacon_has_no_autopilot_to_look_at(tmp_path: Path) -> None:
    done = CliRunner().invoke(program, ["doctor", "autopilot", "--config", str(CONFIGS / "beacon.yaml")])
    assert isinstance(done.exception, CompanionError) and done.exception.exit_code == 2
