"""What telemetry and inputs mean for the mission at this tick: pure, one event for each condition that holds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from companion.core.clock import age_s
from companion.core.inputs import Event
from companion.core.messages import FlightMode, VehicleState
from companion.mission.table import State

MODE_LOST_S: Final = 1.5
"""Without HEARTBEAT and CURRENT_MODE for so long, the mode is not known: the link counts as lost."""
HEARTBEAT_LOST_S: Final = 1.5
"""Heartbeats come at 1 Hz; the edge asks for one that is late, so that a single lost one is not a lost link."""
SLEPT_S: Final = 0.2
"""A suspended host: no other age shows it. Suspending and waking takes longer than this."""
STALLED_S: Final = 0.5
"""Below PX4's COM_OF_LOSS_T, which the preflight wants at 0.75 s or more: after a longer gap in the stream the
autopilot may have acted by itself, and after a shorter one it has not."""
BATTERY_UNKNOWN_S: Final = 5.0
"""A battery that has told nothing for so long; the edge takes a silent one for such after 5 s more."""

_TAKE_OFF_MODES: Final = frozenset({FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD})
_EXPECTED_MODES: Final = {
    State.TAKING_OFF: _TAKE_OFF_MODES,
    State.ACQUIRING: frozenset({FlightMode.OFFBOARD}),
    State.APPROACHING: frozenset({FlightMode.OFFBOARD}),
    State.HOLDING: frozenset({FlightMode.OFFBOARD}),
    State.ARRIVED: frozenset({FlightMode.OFFBOARD, FlightMode.HOLD}),
    State.LANDING: frozenset({FlightMode.OFFBOARD, FlightMode.HOLD, FlightMode.LAND, FlightMode.RETURN}),
}
_LANDING_BY_S: Final = 8.0  # by then landing or returning has begun, or somebody else has decided otherwise
_TRIES_AFTER_S: Final = 5.0
_FLIGHT_STATES: Final = frozenset(_EXPECTED_MODES)
_IN_OFFBOARD: Final = frozenset({State.ACQUIRING, State.APPROACHING, State.HOLDING})
_ENGAGED_STATES: Final = _FLIGHT_STATES | {State.PREFLIGHT}
TIME_LIMITS_S: Final = {State.PREFLIGHT: 10.0, State.TAKING_OFF: 90.0, State.LANDING: 120.0}
"""Of other states the configuration says it, or there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Everything the conditions look at. Ages in seconds; infinite for what was never there."""

    vehicle: VehicleState
    now_ns: int
    in_state_s: float
    """How long the mission has been in its state."""
    took_off: bool
    """The vehicle was seen in the air, or in TAKEOFF, since this engagement."""
    pose_age_s: float
    pose_failed: bool
    """The tracker itself shows that it has lost itself."""
    target_age_s: float
    """Since the target was last heard, by its packets and by its datagrams, whichever is older."""
    blind_legs: float
    """Legs flown since the newest bearing that may steer."""
    tries: int
    """Times the vehicle has held since then."""
    target_near: bool
    stream_gap_s: float
    """Since the last set point that went out, or since the stream began; in preflight since the last tick, which made
    the look that is answered now; else 0."""
    stood_still_s: float = 0.0
    """By how much the vehicle's clock has leapt ahead of ours since the engagement: no clock of ours shows that."""
    slept_s: float = 0.0
    """The host was suspended so long since the last tick."""
    restarted: bool = False
    """The vehicle has restarted since the engagement."""
    left_offboard: bool = False
    """It has left OFFBOARD since then, and may be back."""
    battery_unknown_s: float = 0.0
    """For how long any battery has told nothing, or there was none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConditionLimits:
    """The configuration's part in it."""

    pose_stale_s: float
    pose_lost_s: float
    silent_s: float
    blind_legs: float
    min_battery: float
    approach_s: float
    hold_s: float
    leave_modes: frozenset[FlightMode] = frozenset()
    """Modes in which the autopilot may be left at the target, beside hold."""


def conditions(state: State, situation: Situation, limits: ConditionLimits) -> list[Event]:
    """The events that hold now in `state`, in no particular order."""
    vehicle = situation.vehicle
    in_flight, engaged = state in _FLIGHT_STATES, state in _ENGAGED_STATES
    now_ns = situation.now_ns
    link_lost = (
        age_s(vehicle.mode_mono_ns, now_ns) > MODE_LOST_S or age_s(vehicle.heartbeat_mono_ns, now_ns) > HEARTBEAT_LOST_S
    )
    battery_low = vehicle.battery_remaining is not None and vehicle.battery_remaining < limits.min_battery
    silent = situation.target_age_s > limits.silent_s
    pose_stale = situation.pose_age_s > limits.pose_stale_s
    try_again = (
        state is State.HOLDING and situation.in_state_s > _TRIES_AFTER_S and situation.tries <= limits.blind_legs
    )
    mode_lost = in_flight and situation.took_off and vehicle.mode not in _expected_modes(state, situation, limits)
    mode_was_lost = (engaged and situation.restarted) or (state in _IN_OFFBOARD and situation.left_offboard)
    stalled = max(situation.stream_gap_s, situation.stood_still_s) > STALLED_S or situation.slept_s > SLEPT_S
    holds = (
        (Event.LINK_LOST, link_lost),
        (Event.STALLED, stalled),
        (Event.MODE_LOST, mode_lost or mode_was_lost),
        (Event.POSE_LOST, engaged and (situation.pose_failed or situation.pose_age_s > limits.pose_lost_s)),
        (Event.BATTERY_LOW, engaged and battery_low),
        (Event.BATTERY_UNKNOWN, in_flight and situation.battery_unknown_s > BATTERY_UNKNOWN_S),
        (Event.LANDED, in_flight and situation.took_off and not vehicle.in_air),
        (Event.TIMEOUT, situation.in_state_s > _time_limit_s(state, limits)),
        (Event.POSE_STALE, pose_stale),
        (Event.BEARING_STALE, silent or situation.blind_legs >= limits.blind_legs),
        (Event.BEARING_BACK, try_again and not silent and not pose_stale),
        (Event.TARGET_REACHED, situation.target_near),
    )
    return [event for event, is_so in holds if is_so]


def _expected_modes(state: State, situation: Situation, limits: ConditionLimits) -> frozenset[FlightMode]:
    if state is State.LANDING and situation.in_state_s > _LANDING_BY_S:
        return frozenset({FlightMode.LAND, FlightMode.RETURN})
    return _EXPECTED_MODES[state] | (limits.leave_modes if state is State.ARRIVED else frozenset())


def _time_limit_s(state: State, limits: ConditionLimits) -> float:
    if state in (State.ACQUIRING, State.APPROACHING):
        return limits.approach_s
    if state is State.HOLDING:
        return limits.hold_s
    return TIME_LIMITS_S.get(state, math.inf)
