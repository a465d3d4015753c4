"""The live inputs of a robot: its keys."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.errors import ConfigError
from companion.neighbours.keys import write_key
from companion.roles.inputs import LiveInputs
from tests.paths import CONFIGS


def inputs(folder: Path) -> LiveInputs:
    config = load_config(CONFIGS / "uav.yaml")
    peer = replace(config.peers[0], key_file=str(folder / "peer.key"), next_key_file=str(folder / "peer.next.key"))
    return LiveInputs(
        replace(config, peers=[peer], neighbours=replace(config.neighbours, key_file=str(folder / "own.key")))
    )


def copied(folder: Path, of: str, to: str) -> None:
    (folder / to).write_bytes((folder / of).read_bytes())
    (folder / to).chmod(0o600)


def test_two_robots_have_two_keys(tmp_path: Path) -> None:
    write_key(tmp_path / "own.key")
    copied(tmp_path, "own.key", "peer.key")
    found = inputs(tmp_path)
    found.key(str(tmp_path / "own.key"))
    with pytest.raises(ConfigError, match=r"peer\.key: holds the same key as .*own\.key; each robot has its own"):
        found.key(str(tmp_path / "peer.key"))


def test_a_robot_whose_key_has_just_been_replaced_may_have_it_twice(tmp_path: Path) -> None:
    write_key(tmp_path / "peer.next.key")
    copied(tmp_path, "peer.next.key", "peer.key")
    found = inputs(tmp_path)
    assert found.key(str(tmp_path / "peer.key")) == found.key(str(tmp_path / "peer.next.key"))
