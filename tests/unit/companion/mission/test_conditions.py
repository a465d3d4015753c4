"""Each condition raises its event exactly where it should, and nothing else is raised in a quiet flight."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.clock import NS_PER_S
from companion.core.inputs import Event
from companion.core.messages import FlightMode, VehicleState
from companion.mission.conditions import ConditionLimits, Situation, conditions
from companion.mission.table import State

NOW_NS = 100 * NS_PER_S
LIMITS = ConditionLimits(
    pose_stale_s=0.2, pose_lost_s=8, silent_s=2, blind_legs=3, min_battery=0.2, approach_s=900, hold_s=60
)
FLYING = VehicleState(
    t_mono_ns=NOW_NS,
    heartbeat_mono_ns=NOW_NS - NS_PER_S,
    mode=FlightMode.OFFBOARD,
    mode_mono_ns=NOW_NS,
    armed=True,
    in_air=True,
    battery_remaining=0.8,
)
QUIET = Situation(
    vehicle=FLYING,
    now_ns=NOW_NS,
    in_state_s=1,
    took_off=True,
    pose_age_s=0.01,
    pose_failed=False,
    target_age_s=0.01,
    blind_legs=0,
    tries=0,
    target_near=False,
    stream_gap_s=0.05,
)


@pytest.mark.parametrize("state", [State.ACQUIRING, State.APPROACHING, State.ARRIVED, State.LANDING])
def test_a_quiet_flight_raises_nothing(state: State) -> None:
    assert conditions(state, QUIET, LIMITS) == []


@pytest.mark.parametrize(
    ("event", "situation"),
    [
        (Event.LINK_LOST, replace(QUIET, vehicle=replace(FLYING, mode_mono_ns=NOW_NS - 1_501_000_000))),
        (Event.LINK_LOST, replace(QUIET, vehicle=replace(FLYING, heartbeat_mono_ns=NOW_NS - 1_501_000_000))),
        (Event.STALLED, replace(QUIET, stream_gap_s=0.51)),
        (Event.STALLED, replace(QUIET, stood_still_s=0.51)),
        (Event.MODE_LOST, replace(QUIET, vehicle=replace(FLYING, mode=FlightMode.MANUAL))),
        (Event.MODE_LOST, replace(QUIET, vehicle=replace(FLYING, mode=FlightMode.RETURN))),
        (Event.POSE_LOST, replace(QUIET, pose_failed=True)),
        (Event.POSE_STALE, replace(QUIET, pose_age_s=0.21)),
        (Event.BATTERY_LOW, replace(QUIET, vehicle=replace(FLYING, battery_remaining=0.19))),
        (Event.LANDED, replace(QUIET, vehicle=replace(FLYING, in_air=False))),
        (Event.TIMEOUT, replace(QUIET, in_state_s=901)),
        (Event.BEARING_STALE, replace(QUIET, target_age_s=2.1)),
        (Event.BEARING_STALE, replace(QUIET, blind_legs=3)),
        (Event.TARGET_REACHED, replace(QUIET, target_near=True)),
    ],
)
def test_each_condition_raises_its_event_alone(event: Event, situation: Situation) -> None:
    assert conditions(State.APPROACHING, situation, LIMITS) == [event]


def test_an_unknown_battery_is_not_a_low_one() -> None:
    assert conditions(State.ACQUIRING, replace(QUIET, vehicle=replace(FLYING, battery_remaining=None)), LIMITS) == []


def test_on_the_ground_any_mode_is_fine() -> None:
    waiting = replace(QUIET, took_off=False, vehicle=replace(FLYING, mode=FlightMode.MANUAL, in_air=False, armed=False))
    assert Event.MODE_LOST not in conditions(State.TAKING_OFF, waiting, LIMITS)
    assert Event.LANDED not in conditions(State.TAKING_OFF, waiting, LIMITS)


def test_long_silence_of_the_poses_loses_them() -> None:
    silent = replace(QUIET, pose_age_s=8.1)
    assert set(conditions(State.HOLDING, silent, LIMITS)) == {Event.POSE_LOST, Event.POSE_STALE}


def test_holding_goes_on_only_with_fresh_poses() -> None:
    holding = replace(QUIET, in_state_s=5.1, pose_age_s=0.3)
    assert Event.BEARING_BACK not in conditions(State.HOLDING, holding, LIMITS)
    assert Event.BEARING_BACK in conditions(State.HOLDING, replace(holding, pose_age_s=0.1), LIMITS)


@pytest.mark.parametrize("mode", [FlightMode.LAND, FlightMode.RETURN])
def test_what_the_vehicle_was_left_in_at_the_target_is_expected_there(mode: FlightMode) -> None:
    left = replace(QUIET, vehicle=replace(FLYING, mode=mode))
    assert Event.MODE_LOST in conditions(State.ARRIVED, left, LIMITS)
    assert Event.MODE_LOST not in conditions(State.ARRIVED, left, replace(LIMITS, leave_modes=frozenset({mode})))


def test_holding_tries_again_a_few_times_and_then_lands() -> None:
    holding = replace(QUIET, in_state_s=5.1, blind_legs=3, tries=1)
    assert Event.BEARING_BACK in conditions(State.HOLDING, holding, LIMITS)
    assert Event.BEARING_BACK not in conditions(State.HOLDING, replace(holding, in_state_s=4.9), LIMITS)
    assert Event.BEARING_BACK not in conditions(State.HOLDING, replace(holding, target_age_s=3.0), LIMITS)
    assert Event.BEARING_BACK not in conditions(State.HOLDING, replace(holding, tries=4), LIMITS)
    assert Event.TIMEOUT in conditions(State.HOLDING, replace(holding, tries=4, in_state_s=61), LIMITS)


def test_once_landing_only_landing_is_expected() -> None:
    landing = replace(QUIET, vehicle=replace(FLYING, mode=FlightMode.HOLD), in_state_s=7.0)
    assert conditions(State.LANDING, landing, LIMITS) == []
    assert conditions(State.LANDING, replace(landing, in_state_s=8.1), LIMITS) == [Event.MODE_LOST]


@pytest.mark.parametrize("event", [Event.BATTERY_LOW, Event.POSE_LOST])
def test_the_ground_is_where_to_notice_it(event: Event) -> None:
    bad = replace(QUIET, pose_age_s=9.0, took_off=False, vehicle=replace(FLYING, battery_remaining=0.05))
    assert event in conditions(State.PREFLIGHT, bad, LIMITS)
    assert event not in conditions(State.IDLE, bad, LIMITS)
