"""How a flight went, in one sentence, and a word where errors share a sign."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from companion.core.inputs import Event
from companion.flight.records import SERVICE_ENDS
from companion.mission.table import State
from companion.report.outcome import _WHY, Closest, outcome, shared_sign

Step = tuple[float, dict[str, Any]]


def step(t_s: float, state: str, event: str, then: str, *, reason: str | None = None) -> Step:
    return t_s, {"state": state, "event": event, "next_state": then, "reason": event if reason is None else reason}


TAKEN_OFF = [
    step(1.0, "idle", "engage", "preflight"), step(2.0, "preflight", "preflight_passed", "taking_off"),
    step(5.0, "taking_off", "offboard_confirmed", "acquiring"), step(9.0, "acquiring", "bearing", "approaching"),
]  # fmt: skip
NEAR = Closest(end_m=1.62, nearest_m=1.5, believed_m=1.4, believed_std_m=0.3)


def test_a_target_that_was_reached() -> None:
    steps = [
        *TAKEN_OFF,
        step(62.0, "approaching", "target_reached", "arrived"),
        step(80.0, "arrived", "abort", "latched"),
    ]
    assert outcome(steps, NEAR, 30, 90.0) == (
        "Reached the target 60 s after taking off, 1.6 m from it in truth, 1.4 ± 0.3 m by its own belief."
    )


@pytest.mark.parametrize(
    ("last", "expected"),
    [
        (step(42.0, "approaching", "mode_lost", "latched"), "a pilot or a failsafe took the mode 40 s"),
        (step(42.0, "approaching", "battery_low", "landing"), "the battery was low 40 s"),
        (step(42.0, "holding", "timeout", "landing"), "it took longer than its limit 40 s after"),
        (step(42.0, "taking_off", "takeoff_failed", "latched", reason="denied"), "the take-off failed (denied) 40 s"),
    ],
)  # fmt: skip
def test_what_stopped_it(last: Step, expected: str) -> None:
    told = outcome([*TAKEN_OFF, last], Closest(), 3, 50.0)
    assert told.startswith(f"Did not reach the target: {expected}")


def test_only_the_first_end_of_a_flight_counts() -> None:
    steps = [*TAKEN_OFF, step(30.0, "approaching", "pose_lost", "landing"), step(50.0, "landing", "landed", "idle")]
    assert "the poses were lost 28 s" in outcome(steps, Closest(), 3, 60.0)


def test_a_log_that_ends_in_flight_and_the_services_own_end() -> None:
    ended = step(20.0, "approaching", "task_failed", "fault", reason=SERVICE_ENDS)
    told = outcome([*TAKEN_OFF, ended], Closest(end_m=9.0, nearest_m=4.0), 3, 20.0)
    assert told == (
        "Did not reach the target: the log ends while approaching, 9.0 m from it in truth; "
        "it had been as near as 4.0 m."
    )


def test_nobody_flew() -> None:
    assert outcome([], Closest(), 14, 72.0) == "Nobody flew: 72 s were recorded, with 14 bearings."
    refused = [step(1.0, "preflight", "preflight_failed", "idle", reason="preflight_failed: no packets")]
    assert outcome(refused, Closest(), 0, 5.0) == "Did not fly: preflight_failed: no packets."


def test_every_event_that_may_end_a_flight_has_words() -> None:
    from companion.mission.table import TABLE

    flown = {State.TAKING_OFF, State.ACQUIRING, State.APPROACHING, State.HOLDING}
    rest = {State.IDLE, State.LATCHED, State.FAULT, State.LANDING}
    ends = {event for (state, event), (then, _) in TABLE.items() if state in flown and then in rest}
    assert {str(event) for event in ends} <= set(_WHY)
    assert set(_WHY) <= {str(event) for event in Event}


def test_errors_that_share_a_sign_point_at_north() -> None:
    rng = np.random.default_rng(1)
    assert "9 of 9 azimuth errors lie counter-clockwise" in shared_sign((3.0 + 0.3 * rng.normal(size=9)).tolist())
    assert "lie clockwise of the truth, by 4.0°" in shared_sign([-4.0] * 6)
    assert shared_sign((3.0 * rng.normal(size=30)).tolist()) == ""
    assert shared_sign([3.0, 3.0]) == ""
    assert shared_sign([math.nan] * 9) == ""
