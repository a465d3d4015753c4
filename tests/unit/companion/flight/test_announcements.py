"""What a pilot is told of what is recorded, and that a flood of it stays a trickle."""

from __future__ import annotations

from typing import Any

import pytest

from companion.core.clock import NS_PER_S
from companion.core.inputs import CommandOutcome, Event, Wish
from companion.core.streams import COMMAND, GATE, MISSION, SETPOINT, WISH
from companion.flight.announcements import BURST, PER_S, WAITING, Announcements, named_values
from companion.flight.records import SERVICE_ENDS, GateReport, MissionStep
from companion.mission.table import State
from tests.kept import Kept
from tests.paths import DOCS


def step(state: State, event: Event, next_state: State, reason: str = "") -> MissionStep:
    return MissionStep(
        t_mono_ns=0, state=state, event=event, next_state=next_state, actions=(), reason=reason or str(event)
    )


def test_who_flies_and_why_is_said_and_everything_is_recorded() -> None:
    kept = Kept()
    told = Announcements(kept)
    told.record(WISH, 0, Wish(t_mono_ns=0, wish=Event.ENGAGE, refusal="no poses; no packets"))
    told.record(WISH, 0, Wish(t_mono_ns=0, wish=Event.ENGAGE, refusal=""))
    told.record(MISSION, 1, step(State.IDLE, Event.ENGAGE, State.PREFLIGHT))
    told.record(MISSION, 2, step(State.ACQUIRING, Event.BEARING, State.APPROACHING))
    told.record(MISSION, 2, step(State.APPROACHING, Event.BEARING, State.APPROACHING))
    told.record(SETPOINT, 3, None)
    assert [(one.severity, one.text) for one in told.due(4)] == [
        (5, "companion: preflight (engage)"),
        (5, "companion flies: approaching (bearing)"),
        (4, "companion: engage refused: no poses; no packets"),
    ]
    assert told.counters() == {"written": 6} and not told.failed


def test_commands_that_fail_the_gate_and_the_end_are_said() -> None:
    told = Announcements(Kept())
    told.record(COMMAND, 0, CommandOutcome(0, Event.OFFBOARD_REFUSED, "mode offboard: not confirmed"))
    told.record(COMMAND, 0, CommandOutcome(0, Event.AIRBORNE, ""))
    told.record(GATE, 1, GateReport(1, ("too fast",)))
    told.record(GATE, 2, GateReport(2, ()))
    told.record(MISSION, 3, step(State.HOLDING, Event.MODE_LOST, State.LATCHED))
    told.record(MISSION, 4, step(State.LATCHED, Event.TASK_FAILED, State.FAULT, SERVICE_ENDS))
    assert [(one.severity, one.text) for one in told.due(5)] == [
        (4, "companion: latched (mode_lost)"),
        (4, "companion: the service ends"),
        (4, "companion: mode offboard: not confirmed"),
        (4, "companion: gate holds: too fast"),
        (5, "companion: gate passes again"),
    ]


def test_the_same_refusal_again_and_again_is_said_once_in_ten_seconds() -> None:
    told = Announcements(Kept())
    said = 0
    for tenth in range(300):
        now_ns = tenth * NS_PER_S // 10
        told.record(WISH, now_ns, Wish(t_mono_ns=now_ns, wish=Event.ENGAGE, refusal="no poses"))
        said += len(told.due(now_ns))
    assert said == 3


def test_a_flood_stays_a_trickle_and_a_change_of_state_is_in_it() -> None:
    told = Announcements(Kept())
    messages: list[str] = []
    for tick in range(2000):  # 20 s, 50 refusals in each hundredth
        now_ns = tick * NS_PER_S // 100
        for n in range(50):
            told.record(WISH, now_ns, Wish(t_mono_ns=now_ns, wish=Event.ENGAGE, refusal=f"reason {tick} {n}"))
        if tick == 1000:
            told.record(MISSION, now_ns, step(State.HOLDING, Event.LINK_LOST, State.LATCHED))
        messages += [one.text for one in told.due(now_ns)]
    assert len(messages) <= BURST + 20 * PER_S
    assert any("latched (link_lost)" in text for text in messages)
    assert any(text.startswith("(") and "not told) " in text for text in messages)
    assert told.dropped > 99_000 - WAITING


def test_values_are_those_of_the_status() -> None:
    status: dict[str, Any] = {
        "state": State.HOLDING,
        "bearing": {"azimuth_deg": 120.0, "azimuth_std_deg": None, "reliability": 0.5},
        "bearing_stale": False,
        "target": {"range_m": 4.0, "range_std_m": float("inf")},
    }
    assert named_values(status) == {
        "wsr_state": 6.0,
        "wsr_brg": pytest.approx(330.0),
        "wsr_brg_sd": None,
        "wsr_rel": 0.5,
        "wsr_range": 4.0,
        "wsr_rng_sd": None,
    }
    unknown = named_values(status | {"bearing_stale": True, "target": None, "state": "idle"})
    assert unknown.pop("wsr_state") == 0.0 and set(unknown.values()) == {None}


def test_the_document_gives_each_state_its_number() -> None:
    row = next(line for line in (DOCS / "pilot.md").read_text().splitlines() if line.startswith("| `wsr_state`"))
    for number, state in enumerate(State):
        assert f"{number} {state.replace('_', ' ')}" in row
