"""Configuration files: every error at once, each with its key; the shipped ones load."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from companion.config.file import load_config, save_config
from companion.errors import ConfigError
from tests.paths import CONFIGS

ROBOTS = sorted(CONFIGS.glob("*.yaml"))


def write(tmp_path: Path, **changes: object) -> Path:
    """The demo's flying robot with top-level keys changed."""
    document = yaml.safe_load((CONFIGS / "demo-uav.yaml").read_text()) | changes
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def errors_of(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load_config(path)
    assert caught.value.exit_code == 2
    return str(caught.value)


@pytest.mark.parametrize("path", ROBOTS, ids=lambda path: path.name)
def test_shipped_configurations_load_and_survive_a_round_trip(path: Path, tmp_path: Path) -> None:
    config = load_config(path)
    save_config(config, tmp_path / "copy.yaml")
    assert load_config(tmp_path / "copy.yaml") == config


def test_fault_28_all_errors_are_reported_at_once_with_their_keys(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        csi={"channel": 7, "sorce": "unix"},
        mission={"speed_m_s": "fast"},
        peers=[{"id": 2, "name": "beacon", "mac": "00:21", "key_file": "b.key"}],
        id=0,
    )
    text = errors_of(path)
    for key in ("csi.channel", "csi.sorce", "mission.speed_m_s", "peers[0].mac", "id:"):
        assert key in text
    assert "did you mean source?" in text
    assert "5 errors" in text
    command = [sys.executable, "-m", "companion", "run", "--config", str(path)]
    refused = subprocess.run(command, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert text in refused.stderr


@pytest.mark.parametrize(
    ("channel", "named"),
    [(6, "is a 2.4 GHz channel"), (38, "is the centre of a wide channel"), (37, "is no 5 GHz channel")],
)
def test_only_channels_that_there_are_are_accepted(tmp_path: Path, channel: int, named: str) -> None:
    text = errors_of(write(tmp_path, csi={"channel": channel}))
    assert f"csi.channel: channel {channel} {named}" in text and "expected one of 36" in text


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"role": "plane"}, "role"),
        ({"autopilot": None}, "autopilot: missing"),
        ({"peers": []}, "peers: empty"),
        ({"gate": {"fence_min_m": [5, 0, 0], "fence_max_m": [1, 1, 5]}}, "gate.fence_min_m: x"),
        ({"mission": {"speed_m_s": 1.5}}, "mission.speed_m_s: above gate.max_speed_m_s"),
        ({"mission": {"lateral_weave_m": 0.4}}, "mission.lateral_weave_m"),
        ({"mission": {"takeoff_height_m": float("nan")}}, "mission.takeoff_height_m: expected a finite number"),
        ({"pose": [1, 2]}, "pose: expected a mapping of keys, got list"),
        ({"wings": 2}, "wings: unknown key"),
        ({"neighbours": {"key_file": "uav.key", "rate_hz": 1.0}}, "neighbours.rate_hz: 1; expected at least 2"),
        ({"neighbours": {"key_file": "beacon.key"}}, "key_file: beacon.key stands twice"),
        ({"mission": {"control": "flyy"}}, "mission.control: expected observe or fly (got 'flyy')"),
        (
            {"neighbours": {"key_file": "u", "broadcast": "192.168.01.255"}},
            "neighbours.broadcast: expected four numbers",
        ),
        (
            {"peers": [{"id": 2, "name": "b", "mac": "00-21", "key_file": "b.key"}]},
            "peers[0].mac: expected six pairs of hexadecimal digits with colons between them, for example",
        ),
        ({"pose": {"antenna_m": [0, 0, 5]}}, "pose.antenna_m: 5 m up; expected within 2 m"),
        ({"recorder": {"path": "~/log.mcap"}}, "recorder.path: ~/log.mcap: ~ is not expanded"),
        (
            {"mission": {"min_battery": 0}},
            "mission.min_battery: expected a share of charge of 0.05 to 1, for example 0.2",
        ),
        (
            {"neighbours": {"key_file": "u", "broadcast": "127.255.255.255\n"}},
            "neighbours.broadcast: expected four numbers",
        ),
        ({"state_dir": "~/state"}, "state_dir: ~/state: ~ is not expanded"),
        ({"recorder": {"path": "logs/"}}, "recorder.path: logs/: a folder; expected a file"),
    ],
)
def test_a_wrong_value_names_its_key(tmp_path: Path, changes: dict[str, object], expected: str) -> None:
    assert expected in errors_of(write(tmp_path, **changes))


def test_files_that_are_no_configuration(tmp_path: Path) -> None:
    assert "no such configuration file" in errors_of(tmp_path / "absent.yaml")
    for text, expected in (("", "got nothing"), ("- 1\n", "got list"), ("a: [1\n", "not valid YAML")):
        path = tmp_path / "bad.yaml"
        path.write_text(text)
        assert expected in errors_of(path)
        assert str(path) in errors_of(path)


def test_of_many_errors_the_first_are_shown(tmp_path: Path) -> None:
    path = tmp_path / "many.yaml"
    path.write_text("".join(f"k{n}: 1\n" for n in range(60)))
    with pytest.raises(ConfigError) as told:
        load_config(path)
    lines = str(told.value).splitlines()
    assert len(lines) == 22 and "66 errors" in lines[0] and lines[-1] == "  ..."
