"""The stage of a demo: the world's scenario is the scene's, everything else stays."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from companion.commands.demo import demo
from companion.sim.scenario import RobotScenario, Scenario, load_scenario
from companion.sim.scenes import set_in
from companion.sim.stage import set_stage


def _scenario(folder: Path, scene: str | None) -> Scenario:
    """As the world reads it."""
    folder.mkdir()
    set_stage(folder, folder, seed=2, use_netlink=False, scene=scene)
    read = load_scenario(folder / "scenario.json")
    return replace(read, truth_in="", truth_out="", uav=_placeless(read, "uav"), beacon=_placeless(read, "beacon"))


def _placeless(scenario: Scenario, name: str) -> RobotScenario:
    robot: RobotScenario = getattr(scenario, name)
    return replace(robot, csi=replace(robot.csi, path=""), pose_socket="")


def test_a_scene_takes_the_place_of_the_plain_room(tmp_path: Path) -> None:
    plain = _scenario(tmp_path / "plain", None)
    assert plain.drive_straight_m is None
    for number, name in enumerate(("hard-14db", "far", "north")):
        assert _scenario(tmp_path / str(number), name) == set_in(plain, name) != plain


def test_the_vehicle_of_the_scene_north_believes_its_configuration(tmp_path: Path) -> None:
    (tmp_path / "n").mkdir()
    stage = set_stage(tmp_path / "n", tmp_path, seed=2, use_netlink=False, scene="north")
    off_deg = math.degrees(stage.scenario.uav.frame_yaw_rad) - stage.uav.pose.north_yaw_deg
    assert abs(off_deg) == pytest.approx(10.0)


def test_an_unknown_scene_is_refused_with_the_list() -> None:
    result = CliRunner().invoke(demo, ["--scene", "hell"])
    assert result.exit_code == 2
    assert "'hell' is not one of 'open', 'hall', 'far'" in result.output


def test_with_ax_cards_both_robots_hear_80_mhz_and_nothing_else_changes(tmp_path: Path) -> None:
    (tmp_path / "ax").mkdir()
    stage = set_stage(tmp_path / "ax", tmp_path, seed=2, use_netlink=False, scene="hard", card="ax210")
    radio = load_scenario(tmp_path / "ax" / "scenario.json").radio
    assert (radio.card, radio.width_mhz, radio.channel) == ("ax210", 80, 106)
    assert radio.reflectors == _scenario(tmp_path / "plain", "hard").radio.reflectors
    assert (stage.transport, stage.uav.csi.channel) == ("unix", 108)
