"""The study of whole missions."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.sim.scenes import fence_in
from companion.study import rendezvous, virtual_mission
from companion.study.catalogue import study
from companion.study.study import Settings
from companion.study.trials import trial_seed
from tests.paths import DATA
from tests.unit.companion.study.few_trials import SEED, check_leftovers


@pytest.mark.long
def test_rendezvous_is_the_same_mission_whatever_else_is_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendezvous, "MAX_TIME_S", 12.0)
    one = study("rendezvous")
    (case,) = one.plan(Settings(1, DATA, ("hall",)))
    first = one.trial(case, trial_seed(SEED, 1))
    assert len(first.steps) > 5
    assert first == one.trial(case, trial_seed(SEED, 7))


@pytest.mark.long
def test_rendezvous_arrives_and_says_so(tmp_path: Path) -> None:
    one = study("rendezvous")
    (case,) = one.plan(Settings(1, DATA, ("hall",)))
    first = one.trial(case, trial_seed(SEED, 1))
    assert (first.end, first.succeeded, first.kept_silent, first.left_room) == ("arrived", True, False, False)
    assert first.closest_m <= first.arrived_m < 2.0
    assert 26.0 < first.straight_s < first.reached_s < first.time_s
    assert len(first.approach) > 3
    assert all(step.distance_m > 1.5 for step in first.approach)
    errors = [step.great_circle_deg for step in first.steps if step.great_circle_deg is not None]
    assert np.median(errors) < 10.0
    assert all(step.informativeness_deg is not None for step in first.steps if step.azimuth_deg is not None)
    assert any(step.belief is not None for step in first.steps)
    outcome = check_leftovers(one, [first], tmp_path)
    assert outcome.scenes["hall"]["success"] == 1.0
    assert one.table is not None
    assert "| hall | 1 | 100 (20.7-100) | 0 (0-79.3) |" in one.table(outcome)


@pytest.mark.long
@pytest.mark.parametrize("number", range(4))
def test_a_robot_beyond_the_fence_is_expected_within_and_not_believed_to_be_there(
    monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    near = "companion.study.virtual_mission.fence_in"
    monkeypatch.setattr(near, lambda room, gate: replace(fence_in(room, gate), fence_radius_m=8.0))
    monkeypatch.setattr(rendezvous, "MAX_TIME_S", 120.0)
    row = study("rendezvous").trial(rendezvous.MissionCase("hard", number), trial_seed(SEED, 1))
    assert row.closest_m > 5.0, "it stands 15 m away"
    assert row.arrived_m is None, row.arrived_m


def test_a_wall_ends_a_mission(monkeypatch: pytest.MonkeyPatch) -> None:
    """What stands behind it, a mirror image, is never reached."""
    monkeypatch.setattr("companion.study.virtual_mission.is_outside", lambda room, p_m: math.hypot(*p_m[:2]) > 0.4)
    one = study("rendezvous")
    row = one.trial(one.plan(Settings(1, DATA, ("hall",)))[0], trial_seed(SEED, 1))
    assert (row.end, row.left_room, row.arrived_m, row.succeeded) == ("crashed", True, None, False)
    assert row.time_s < 10.0


def test_from_high_up_a_vehicle_comes_down_to_where_it_can_say_that_it_has_arrived(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Three metres up, a robot on the floor is never within two metres. Of these it is nine in ten sure when it says
    so: a foot more is no false arrival."""
    usual = virtual_mission.config()
    high = replace(usual, mission=replace(usual.mission, takeoff_height_m=3.0))
    monkeypatch.setattr(virtual_mission, "config", lambda: high)
    one = study("rendezvous")
    row = one.trial(one.plan(Settings(1, DATA, ("open",)))[0], trial_seed(SEED, 1))
    assert row.arrived_m is not None and row.arrived_m < 2.5, (row.end, row.arrived_m)


def test_rendezvous_shares_its_missions_out_to_scenes_in_turn() -> None:
    plan = study("rendezvous").plan(Settings(5, DATA, ("hard", "open")))
    assert [(case.scene, case.number) for case in plan] == [
        ("hard", 0), ("open", 0), ("hard", 1), ("open", 1), ("hard", 2),
    ]  # fmt: skip
    everywhere = study("rendezvous").plan(Settings(24, DATA))
    assert len({case.scene for case in everywhere}) == 12
    assert all(case.chooses_motion for case in everywhere), "as the service flies"
    by_rule = study("rendezvous").plan(Settings(2, DATA, motion="fixed"))
    assert [(case.scene, case.number, case.chooses_motion) for case in by_rule] == [
        ("open", 0, False),
        ("hall", 0, False),
    ]


def test_drawn_truths_are_other_in_each_mission_and_the_same_whatever_else_is_flown() -> None:
    plan = study("rendezvous").plan(Settings(400, DATA, ("hall", "far"), truths="drawn"))
    assert all(case.draws_truths for case in plan)
    worlds = [rendezvous.world(case, trial_seed(SEED, 1)) for case in plan]
    assert worlds[5] == rendezvous.world(plan[5], trial_seed(SEED, 9))
    for name in ("hall", "far"):
        drawn = [each for case, each in zip(plan, worlds, strict=True) if case.scene == name]
        distances_m = np.array([each.start_distance_m for each in drawn])
        assert 3.0 < distances_m.min() < 5.0
        assert 33.0 < distances_m.max() < 35.0
        assert np.mean(distances_m) == pytest.approx(19.0, abs=2.0)
        turned_deg = np.degrees([(each.uav.frame_yaw_rad, each.beacon.frame_yaw_rad) for each in drawn])
        assert np.std(turned_deg, axis=0) == pytest.approx(9.0, abs=1.5)
        assert abs(np.corrcoef(turned_deg.T)[0, 1]) < 0.25
    fixed = study("rendezvous").plan(Settings(20, DATA, ("hall", "far")))
    assert {rendezvous.world(case, trial_seed(SEED, 1)).start_distance_m for case in fixed} == {15.0, 30.0}
