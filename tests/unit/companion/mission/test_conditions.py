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
        (Event.BATTERY_UNKNOWN, replace(QUIET, battery_unknown_s=6.0)),
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


@pytest.mark.parametrize(
    ("event", "state", "at_limit", "beyond"),
    [
        (Event.LINK_LOST, State.APPROACHING, {"mode_mono_ns": NOW_NS - 1_500_000_000}, {"mode_mono_ns": 0}),
        (Event.LINK_LOST, State.APPROACHING, {"heartbeat_mono_ns": NOW_NS - 1_500_000_000}, {"heartbeat_mono_ns": 0}),
        (Event.BATTERY_UNKNOWN, State.APPROACHING, {"battery_unknown_s": 5.0}, {"battery_unknown_s": 5.1}),
        (Event.BATTERY_UNKNOWN, State.ARRIVED, {"battery_unknown_s": 5.0}, {"battery_unknown_s": 600.0}),
        (Event.BATTERY_LOW, State.APPROACHING, {"battery_remaining": 0.2}, {"battery_remaining": 0.0}),
        (Event.STALLED, State.APPROACHING, {"stream_gap_s": 0.5}, {"stream_gap_s": 600.0}),
        (Event.STALLED, State.APPROACHING, {"stood_still_s": 0.5}, {"stood_still_s": 600.0}),
        (Event.STALLED, State.APPROACHING, {"slept_s": 0.2}, {"slept_s": 0.21}),
        (Event.STALLED, State.APPROACHING, {"slept_s": 0.2}, {"slept_s": 600.0}),
        (Event.POSE_STALE, State.APPROACHING, {"pose_age_s": 0.2}, {"pose_age_s": 7.9}),
        (Event.POSE_LOST, State.APPROACHING, {"pose_age_s": 8.0}, {"pose_age_s": 600.0}),
        (Event.BEARING_STALE, State.APPROACHING, {"target_age_s": 2.0}, {"target_age_s": 600.0}),
        (Event.BEARING_STALE, State.APPROACHING, {"blind_legs": 2}, {"blind_legs": 400}),
        (Event.TIMEOUT, State.PREFLIGHT, {"in_state_s": 10.0}, {"in_state_s": 10.1}),
        (Event.TIMEOUT, State.TAKING_OFF, {"in_state_s": 90.0}, {"in_state_s": 90.1}),
        (Event.TIMEOUT, State.ACQUIRING, {"in_state_s": 900.0}, {"in_state_s": 900.1}),
        (Event.TIMEOUT, State.APPROACHING, {"in_state_s": 900.0}, {"in_state_s": 900.1}),
        (Event.TIMEOUT, State.HOLDING, {"in_state_s": 60.0}, {"in_state_s": 60.1}),
        (Event.TIMEOUT, State.LANDING, {"in_state_s": 120.0}, {"in_state_s": 120.1}),
        (Event.MODE_LOST, State.LANDING, {"in_state_s": 8.0}, {"in_state_s": 8.1}),
        (Event.BEARING_BACK, State.HOLDING, {"in_state_s": 5.0}, {"in_state_s": 5.1}),
        (Event.BEARING_BACK, State.HOLDING, {"in_state_s": 9.0, "tries": 4}, {"in_state_s": 9.0, "tries": 3}),
    ],
)
def test_a_limit_itself_is_still_within_it(
    event: Event, state: State, at_limit: dict[str, float], beyond: dict[str, float]
) -> None:
    assert event not in conditions(state, _changed(at_limit), LIMITS)
    assert event in conditions(state, _changed(beyond), LIMITS)


def test_nothing_stands_still_or_sleeps_unless_it_is_told() -> None:
    assert QUIET.stood_still_s == 0.0 and QUIET.slept_s == 0.0


@pytest.mark.parametrize("state", [state for state in State if state not in (State.LANDING, State.HOLDING)])
def test_only_a_landing_must_have_begun_by_a_time(state: State) -> None:
    """Of all states, whatever their names sort after."""
    mode = FlightMode.HOLD if state in (State.TAKING_OFF, State.ARRIVED) else FlightMode.OFFBOARD
    late = replace(QUIET, in_state_s=9.0, vehicle=replace(FLYING, mode=mode))
    assert Event.MODE_LOST not in conditions(state, late, LIMITS)
    assert Event.BEARING_BACK not in conditions(state, late, LIMITS)


@pytest.mark.parametrize("state", [State.ACQUIRING, State.APPROACHING, State.HOLDING, State.TAKING_OFF])
def test_what_the_vehicle_is_left_in_at_the_target_is_expected_nowhere_else(state: State) -> None:
    landing = replace(QUIET, vehicle=replace(FLYING, mode=FlightMode.LAND))
    assert Event.MODE_LOST in conditions(state, landing, replace(LIMITS, leave_modes=frozenset({FlightMode.LAND})))


def test_to_be_left_in_hold_is_expected_once_or_twice() -> None:
    held = replace(QUIET, vehicle=replace(FLYING, mode=FlightMode.HOLD))
    assert conditions(State.ARRIVED, held, replace(LIMITS, leave_modes=frozenset({FlightMode.HOLD}))) == []


@pytest.mark.parametrize("state", [State.IDLE, State.LATCHED, State.FAULT, State.ARRIVED])
def test_a_state_without_a_limit_lasts_as_long_as_it_lasts(state: State) -> None:
    assert Event.TIMEOUT not in conditions(state, replace(QUIET, in_state_s=1e6), LIMITS)


def _changed(values: dict[str, float]) -> Situation:
    """The quiet one, in hold where a landing may begin, with other values of itself or of its vehicle."""
    vehicle = replace(FLYING, mode=FlightMode.HOLD)
    ours = {name: value for name, value in values.items() if not hasattr(vehicle, name)}
    theirs = {name: value for name, value in values.items() if hasattr(vehicle, name)}
    return replace(QUIET, vehicle=replace(vehicle, **theirs), **ours)  # type: ignore[arg-type]


_IN_OFFBOARD = (State.ACQUIRING, State.APPROACHING, State.HOLDING)
_RESTING = (State.IDLE, State.LATCHED, State.FAULT)


@pytest.mark.parametrize("state", State)
def test_a_mode_that_was_lost_and_is_back_is_lost(state: State) -> None:
    """In the other states OFFBOARD is left by our own doing."""
    left = conditions(state, replace(QUIET, left_offboard=True), LIMITS)
    assert (Event.MODE_LOST in left) == (state in _IN_OFFBOARD or Event.MODE_LOST in conditions(state, QUIET, LIMITS))


@pytest.mark.parametrize("state", State)
def test_a_vehicle_that_has_restarted_is_nobodys(state: State) -> None:
    assert (Event.MODE_LOST in conditions(state, replace(QUIET, restarted=True), LIMITS)) == (state not in _RESTING)
