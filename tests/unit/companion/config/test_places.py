"""Paths that cannot mean what was meant, and antennas where no robot has one."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.config.file import load_config
from companion.config.places import LONGEST_LEVER_M, lever_errors, path_errors
from companion.config.schema import Config
from tests.paths import CONFIGS

UAV = load_config(CONFIGS / "demo-uav.yaml")


def _with_lever(antenna_m: tuple[float, float, float]) -> Config:
    return replace(UAV, pose=replace(UAV.pose, antenna_m=antenna_m))


def test_what_is_shipped_has_no_errors() -> None:
    assert [*path_errors(UAV), *lever_errors(UAV)] == []


@pytest.mark.parametrize(
    ("config", "error"),
    [
        (replace(UAV, state_dir="~/state"), "state_dir: ~/state: ~ is not expanded"),
        (replace(UAV, state_dir="$HOME/state"), "state_dir: $HOME/state: variables such as $HOME are not put in"),
        (replace(UAV, state_dir="/x/${USER}"), "state_dir: /x/${USER}: variables"),
        (replace(UAV, tak=replace(UAV.tak, ca_file="~/ca.pem")), "tak.ca_file: ~/ca.pem: ~ is not expanded"),
        (replace(UAV, control_socket=""), "control_socket: ''; expected a path"),
        (replace(UAV, status_socket="a\0b"), r"status_socket: 'a\x00b'; expected a path"),
        (replace(UAV, recorder=replace(UAV.recorder, path="logs/")), "recorder.path: logs/: a folder; expected a file"),
        (replace(UAV, recorder=replace(UAV.recorder, path="logs/..")), "recorder.path: logs/..: a folder"),
        (
            replace(UAV, peers=[replace(UAV.peers[0], next_key_file="~/key")]),
            "peers[0].next_key_file: ~/key: ~ is not expanded",
        ),
    ],
)
def test_a_path_that_cannot_be_meant_is_named_by_its_key(config: Config, error: str) -> None:
    (told,) = path_errors(config)
    assert told.startswith(error)


def test_a_lever_is_told_by_axis_and_only_where_it_is_too_long() -> None:
    assert list(lever_errors(_with_lever((LONGEST_LEVER_M, -LONGEST_LEVER_M, 0.0)))) == []
    forward, up = lever_errors(_with_lever((5.0, 0.1, -12.0)))
    assert forward.startswith("pose.antenna_m: 5 m forward; expected within 2 m of the tracker")
    assert up.startswith("pose.antenna_m: -12 m up; ")
