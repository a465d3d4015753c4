"""Scenario files are read strictly; the beacon drives when it should."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.errors import ConfigError
from companion.sim.scenario import encode_scenario, load_scenario
from companion.sim.trajectory import BeaconDrive, VehicleTrack
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


def test_the_beacon_stands_on_its_circle_and_drives_below_half_the_distance() -> None:
    drive = BeaconDrive(scene(4))
    start_m = drive.trajectory(0.0, 1.0).p_enu_m[0]
    assert np.linalg.norm(start_m) == pytest.approx(15.0)
    drive.watch(10.0, 7.6)
    assert drive.velocity(20.0) == (0.0, 0.0, 0.0)
    drive.watch(20.0, 7.4)
    drive.watch(25.0, 7.0)
    path = drive.trajectory(19.0, 40.0)
    assert path.p_enu_m[0].tolist() == start_m.tolist()
    assert np.linalg.norm(path.p_enu_m[-1] - start_m) == pytest.approx(0.1 * 20 - 0.025)
    assert math.hypot(*drive.velocity(30.0)) == pytest.approx(0.1)
    steps_m_s = np.linalg.norm(np.diff(path.p_enu_m, axis=0), axis=1) / np.diff(path.t_s)
    assert steps_m_s.max() < 0.1001
    assert math.atan2(*drive.velocity(30.0)[1::-1]) == pytest.approx(drive.yaw_rad)


def test_seeds_place_the_beacon_differently() -> None:
    starts = {tuple(BeaconDrive(scene(seed)).trajectory(0.0, 1.0).p_enu_m[0].tolist()) for seed in (1, 1, 2, 3)}
    assert len(starts) == 3


def test_a_vehicle_track_is_cut_around_the_slot_and_unwraps_yaw() -> None:
    track = VehicleTrack()
    for k in range(100):
        track.append(k * 0.01, (k * 0.1, 0.0, 0.0), math.remainder(3.0 + k * 0.01, math.tau))
    track.append(0.5, (99.0, 0.0, 0.0), 0.0)  # late, ignored
    cut = track.trajectory(0.305, 0.322)
    assert cut.t_s.tolist() == pytest.approx([0.30, 0.31, 0.32, 0.33])
    p_enu_m, yaw_rad = cut.at(np.array([0.315]))
    assert p_enu_m[0, 0] == pytest.approx(3.15)
    assert yaw_rad[0] == pytest.approx(3.315)
    assert track.newest_s == pytest.approx(0.99)
    assert track.trajectory(2.0, 2.1).at(np.array([2.05]))[0][0, 0] == pytest.approx(9.9)
