"""Missions under random faults, judged by the promises of docs/safety.md; and each rule seen red once."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from companion.core.clock import NS_PER_S, HostSleep
from companion.core.inputs import Event, Wish
from companion.flight.loop import Flight
from companion.flight.rc_switch import RcSwitch
from companion.flight.records import MissionStep
from companion.mission import table
from companion.mission.table import State
from companion.safety.gate import Gate, Verdict
from companion.sim.px4.commander import Mode
from tests.faults.figures import record
from tests.faults.missions import promises
from tests.faults.missions.fly import fly
from tests.faults.missions.scenario import CHECKS_FROM, Fault, Scenario, draw
from tests.faults.missions.trace import Asked, Faulted, Sent, Trace
from tests.paths import ROOT

# A command that is given up before it began was never awaited; the service says so in no other way.
pytestmark = pytest.mark.filterwarnings("ignore:.*never awaited", "ignore::pytest.PytestUnraisableExceptionWarning")

_BLOCK = 10
_BLOCKS = 20
"""`make faults` flies the campaign beside, in two processes."""
_PLAIN = 3
"""A seed whose vehicle starts in the air and may be engaged."""


@pytest.mark.parametrize("block", [*range(10), *(pytest.param(n, marks=pytest.mark.long) for n in range(10, _BLOCKS))])
def test_fault_43_random_missions_keep_the_promises(block: int) -> None:
    broken = {}
    for seed in range(block * _BLOCK, (block + 1) * _BLOCK):
        if found := promises.violations(fly(draw(seed))):
            broken[seed] = found
    assert broken == {}


@pytest.mark.parametrize("block", [0, 1, *(pytest.param(n, marks=pytest.mark.long) for n in range(2, 5))])
def test_fault_43_missions_whose_arming_checks_fail_keep_the_promises(block: int) -> None:
    broken, first = {}, CHECKS_FROM + block * _BLOCK
    for seed in range(first, first + _BLOCK):
        if found := promises.violations(fly(draw(seed))):
            broken[seed] = found
    assert broken == {}


def flight_with(*faults: Fault, **changes: Any) -> Scenario:
    """In the air, engaged after 2 s, with these faults."""
    plain = draw(_PLAIN)
    mission = dataclasses.replace(
        plain.config.mission, control="fly", limit_s=900.0, setpoints="position", arrival_range_m=2.0
    )
    config = dataclasses.replace(plain.config, mission=dataclasses.replace(mission, **changes))
    engage = Fault(at_s=2.0, kind="engage", word="", for_s=0.0, size=0.0)
    return dataclasses.replace(
        plain, config=config, faults=tuple(sorted((engage, *faults), key=lambda fault: fault.at_s)),
        starts_in_air=True, asks_again=0, step_ns=50_000_000, rc_loss_act=5, target_enu_m=(8.0, 0.0, 1.0),
    )  # fmt: skip


def broken_by(scenario: Scenario) -> set[str]:
    return {one.promise for one in promises.violations(fly(scenario))}


def states(trace: Trace) -> list[State]:
    return [step.next_state for step in trace.of(MissionStep)]


def test_a_mission_without_faults_streams_and_keeps_every_promise() -> None:
    trace = fly(flight_with())
    assert State.ACQUIRING in states(trace)
    assert len(trace.of(Sent)) > 60
    assert promises.violations(trace) == []


def test_the_same_seed_is_the_same_mission() -> None:
    assert fly(draw(7)).entries == fly(draw(7)).entries


def test_a_suspended_host_does_not_take_the_vehicle_back() -> None:
    trace = fly(flight_with(Fault(at_s=5.0, kind="pause", word="suspend", for_s=0.0, size=0.8)))
    assert promises.violations(trace) == []
    assert trace.of(MissionStep)[-2].event is Event.STALLED


def test_red_a_suspended_host_that_nothing_tells_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(HostSleep, "seconds", lambda _: 0.0)
    monkeypatch.setattr("companion.autopilot.vehicle_clock._LEAP_NS", 1 << 62)
    assert "never_taken_back" in broken_by(
        flight_with(Fault(at_s=5.0, kind="pause", word="suspend", for_s=0.0, size=0.8))
    )


_WHILE_PREFLIGHT = tuple(
    Fault(at_s=2.0 + 0.05 * i, kind="pause", word="loop", for_s=0.0, size=0.45) for i in range(1, 6)
)
"""One of these falls between the preflight's look and the tick that takes its answer."""


def test_a_pause_between_the_preflights_look_and_its_answer_ends_it() -> None:
    traces = [fly(flight_with(pause)) for pause in _WHILE_PREFLIGHT]
    assert [promises.violations(trace) for trace in traces] == [[]] * len(traces)
    steps = {(step.state, step.event) for trace in traces for step in trace.of(MissionStep)}
    assert (State.PREFLIGHT, Event.STALLED) in steps


def test_red_a_preflight_whose_answer_may_be_old(monkeypatch: pytest.MonkeyPatch) -> None:
    lame = {pair: step for pair, step in table.TABLE.items() if pair != (State.PREFLIGHT, Event.STALLED)}
    monkeypatch.setattr(table, "TABLE", lame)
    assert any("preflight_holds" in broken_by(flight_with(pause)) for pause in _WHILE_PREFLIGHT)


@pytest.mark.parametrize("seed", [9668, 18314, 22334])
def test_a_pilot_who_ends_offboard_as_it_is_granted_keeps_the_vehicle(seed: int) -> None:
    assert promises.violations(fly(draw(seed))) == []


_AS_GRANTED = tuple(Fault(at_s=3.0 + 0.05 * i, kind="pilot", word="HOLD", for_s=0.0, size=0.0) for i in range(10))
"""One of these falls between the granting of OFFBOARD and the telling of it."""


def test_a_pilot_who_chooses_hold_as_offboard_is_granted_keeps_the_vehicle() -> None:
    assert [promises.violations(fly(flight_with(pilot))) for pilot in _AS_GRANTED] == [[]] * len(_AS_GRANTED)


def test_red_an_edge_that_asks_again_for_what_was_granted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.autopilot.mavsdk_edge._ACCEPTED", -1)
    assert set().union(*(broken_by(flight_with(pilot)) for pilot in _AS_GRANTED)) == {"never_taken_back"}


def test_red_an_abort_that_leaves_a_granted_engagement(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.flight.course.Course.withdraw", lambda _: None)
    aborts = [Fault(at_s=2.0 + 0.05 * i, kind="abort", word="", for_s=0.0, size=0.0) for i in range(1, 5)]
    assert any("abort_ends_it" in broken_by(flight_with(abort)) for abort in aborts)


def test_red_a_table_that_stays_when_the_mode_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    lame = {pair: step for pair, step in table.TABLE.items() if pair[1] is not Event.MODE_LOST}
    monkeypatch.setattr(table, "TABLE", lame)
    monkeypatch.setattr(Gate, "check", _passes_everything)
    assert {"lost_mode_is_left", "only_in_our_modes"} <= broken_by(
        flight_with(Fault(at_s=6.0, kind="pilot", word="POSCTL", for_s=0.0, size=0.0))
    )


def test_red_a_table_that_goes_on_after_a_stall(monkeypatch: pytest.MonkeyPatch) -> None:
    lame = {pair: step for pair, step in table.TABLE.items() if pair[1] is not Event.STALLED}
    monkeypatch.setattr(table, "TABLE", lame)
    assert "still_stream_is_over" in broken_by(
        flight_with(Fault(at_s=6.1, kind="pause", word="process", for_s=0.0, size=0.42))
    )


def test_red_an_end_that_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    lame = {pair: step for pair, step in table.TABLE.items() if pair[1] is not Event.ABORT}
    monkeypatch.setattr(table, "TABLE", lame)
    assert "abort_ends_it" in broken_by(flight_with(Fault(at_s=6.0, kind="abort", word="", for_s=0.0, size=0.0)))


@pytest.mark.parametrize(
    ("event", "fault", "promise"),
    [
        (Event.LINK_LOST, Fault(at_s=6.0, kind="mute", word="heartbeats", for_s=4.0, size=0.0), "fresh"),
        (Event.BATTERY_LOW, Fault(at_s=6.0, kind="battery", word="low", for_s=6.0, size=0.0), "faults_end_the_stream"),
        (
            Event.BATTERY_UNKNOWN,
            Fault(at_s=6.0, kind="battery", word="silent", for_s=20.0, size=0.0),
            "faults_end_the_stream",
        ),
        (
            Event.BATTERY_UNKNOWN,
            Fault(at_s=6.0, kind="battery", word="second unknown", for_s=20.0, size=0.0),
            "faults_end_the_stream",
        ),
        (Event.POSE_LOST, Fault(at_s=4.0, kind="poses", word="silent", for_s=12.0, size=0.0), "faults_end_the_stream"),
    ],
)
def test_red_a_table_that_does_not_hear_a_fault(
    monkeypatch: pytest.MonkeyPatch, event: Event, fault: Fault, promise: str
) -> None:
    lame = {pair: step for pair, step in table.TABLE.items() if pair[1] is not event}
    monkeypatch.setattr(table, "TABLE", lame)
    assert promise in broken_by(flight_with(fault))


def test_red_an_end_that_leaves_nobody_in_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    async def nothing(self: object) -> None: ...

    monkeypatch.setattr("companion.flight.commands.FlightCommands.leave_at_end", nothing)
    assert "restart_is_idle" in broken_by(flight_with(Fault(at_s=6.0, kind="stop", word="", for_s=0.0, size=0.5)))


@pytest.mark.parametrize("word", ["", "high", "silent"])
def test_fault_33_a_way_home_that_somebody_raised_in_flight_is_not_flown(word: str) -> None:
    changed = Fault(at_s=6.0, kind="parameters", word=word, for_s=60.0, size=0.0)
    lost = Fault(at_s=8.0, kind="packets", word="", for_s=60.0, size=0.0)
    trace = fly(flight_with(changed, lost, lost_target="return", hold_limit_s=2.0, limit_s=60.0))
    asked = {one.wanted for one in trace.entries if isinstance(one, Asked) and one.what == "mode"}
    assert (Mode.LAND in asked, Mode.RTL in asked) == ((True, False) if word else (False, True))


@pytest.mark.parametrize("word", ["silent", "unknown", "second unknown"])
def test_fault_32_a_battery_that_tells_nothing_any_more_lands_the_vehicle(word: str) -> None:
    trace = fly(flight_with(Fault(at_s=6.0, kind="battery", word=word, for_s=30.0, size=0.0)))
    (begun_ns,) = (
        one.t_ns for one in trace.entries if isinstance(one, Faulted) and one.begins and one.fault.kind == "battery"
    )
    landing_ns, *_ = (
        one.t_mono_ns for one in trace.entries
        if isinstance(one, MissionStep) and one.event is Event.BATTERY_UNKNOWN and one.next_state is State.LANDING
    )  # fmt: skip
    after_s = (landing_ns - begun_ns) / NS_PER_S
    record(32, battery=word, landing_after_s=round(after_s, 1))
    assert 4.9 < after_s < 12.1


def test_red_an_abort_that_keeps_streaming_is_not_left_in_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    async def nothing(self: object) -> None: ...

    monkeypatch.setattr("companion.flight.commands.FlightCommands.hold", nothing)
    # The autopilot's own failsafe flies a second later, and its intention stays OFFBOARD.
    later = Fault(at_s=12.0, kind="packets", word="", for_s=1.0, size=0.0)
    assert "left_in_hold" in broken_by(flight_with(Fault(at_s=6.0, kind="abort", word="", for_s=0.0, size=0.0), later))


def test_red_a_gate_that_passes_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Gate, "check", _passes_everything)
    assert "within_limits" in broken_by(flight_with(speed_m_s=1.9, acceleration_m_s2=4.0))


def test_red_a_gate_and_a_table_that_do_not_look_at_ages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Gate, "check", _passes_everything)
    assert "fresh" in broken_by(flight_with(Fault(at_s=6.0, kind="mute", word="position", for_s=3.0, size=0.0)))


def test_red_a_preflight_that_passes_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.flight.engagement.readiness_problems", lambda *_: [])
    assert "preflight_holds" in broken_by(flight_with(Fault(at_s=0.5, kind="clock", word="", for_s=5.0, size=0.0)))


@pytest.mark.parametrize("seed", [41944, 312802])
def test_a_hold_is_asked_for_anew_by_who_engages_between(seed: int) -> None:
    """Each of the two holds for 3 s at most; the rule once took both for one."""
    assert promises.violations(fly(draw(seed))) == []


@pytest.mark.parametrize("seed", [CHECKS_FROM + 454, CHECKS_FROM + 712])
def test_what_has_been_armed_needs_no_checks(seed: int) -> None:
    """Engaged again in the air, while nothing was told of them."""
    assert promises.violations(fly(draw(seed))) == []


_CHECKS_FAIL = Fault(at_s=0.0, kind="checks", word="accel_missing", for_s=30.0, size=0.0)


def on_the_ground(*faults: Fault) -> Scenario:
    """Where PX4's own checks count: armed they have passed."""
    return dataclasses.replace(flight_with(*faults), starts_in_air=False)


def test_a_vehicle_whose_checks_fail_is_refused_with_the_reason_and_never_asked_to_arm() -> None:
    trace = fly(on_the_ground(_CHECKS_FAIL))
    (refused,) = [wish.refusal for wish in trace.of(Wish) if wish.wish is Event.ENGAGE]
    assert "PX4's own arming checks fail: accel missing" in refused
    assert trace.of(Asked, Sent) == [] and promises.violations(trace) == []
    assert State.TAKING_OFF in states(fly(on_the_ground()))


@pytest.mark.parametrize("word", ["accel_missing", "unexplained", "untold"])
def test_red_checks_that_nobody_looks_at(monkeypatch: pytest.MonkeyPatch, word: str) -> None:
    monkeypatch.setattr("companion.autopilot.arming_checks.ArmingChecks.passed", lambda *_: True)
    failing = dataclasses.replace(_CHECKS_FAIL, word=word)
    assert "preflight_holds" in broken_by(on_the_ground(failing))


def test_red_a_service_that_engages_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    real = Flight.tick

    def eager(self: Flight, now_ns: int, slept_s: float = 0.0) -> None:
        if self.state is State.IDLE and now_ns > 12 * NS_PER_S:
            self._course.report(Event.ENGAGE)
            self._engagement._checked_ns = now_ns
        real(self, now_ns, slept_s)

    monkeypatch.setattr(Flight, "tick", eager)
    scenario = dataclasses.replace(flight_with(), faults=(Fault(at_s=8.0, kind="jump", word="", for_s=0.0, size=0.0),))
    assert "person_engages" in broken_by(scenario)


def test_red_an_observer_that_speaks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.flight.engagement.readiness_problems", lambda *_: [])
    monkeypatch.setattr("companion.flight.loop.SilentAutopilot", lambda autopilot: autopilot)
    assert "observing_is_silent" in broken_by(flight_with(control="observe"))


def test_red_a_loop_that_sends_twice(monkeypatch: pytest.MonkeyPatch) -> None:
    real = Flight._send

    def twice(self: Flight, setpoint: Any) -> None:
        real(self, setpoint)
        real(self, setpoint)

    monkeypatch.setattr(Flight, "_send", twice)
    assert "one_per_tick" in broken_by(flight_with())


def test_red_a_mode_that_is_asked_for_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.autopilot.mavsdk_edge.MavsdkAutopilot._set_mode.__defaults__", (9.0,))
    monkeypatch.setattr("companion.autopilot.mavsdk_edge.MavsdkAutopilot._command.__defaults__", (9.0,))
    assert "asked_for_3_s" in broken_by(
        flight_with(Fault(at_s=2.2, kind="offboard", word="silent", for_s=15.0, size=0.0))
    )


def test_red_a_flight_that_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: object, *_: object) -> None:
        raise ValueError("a part of the flight")

    monkeypatch.setattr(Flight, "_send", broken)
    assert "nothing_raises" in broken_by(flight_with())


def test_red_a_latch_that_is_left_by_a_bearing(monkeypatch: pytest.MonkeyPatch) -> None:
    open_latch = {**table.TABLE, (State.LATCHED, Event.BEARING_STALE): (State.IDLE, ())}
    monkeypatch.setattr(table, "TABLE", open_latch)
    faults = (
        Fault(at_s=6.0, kind="abort", word="", for_s=0.0, size=0.0),
        Fault(at_s=6.5, kind="packets", word="", for_s=6.0, size=0.0),
        Fault(at_s=14.0, kind="jump", word="", for_s=0.0, size=0.0),
    )
    assert "latched_until_engaged" in broken_by(flight_with(*faults))


def test_red_a_switch_that_engages_as_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    def standing(self: RcSwitch, rc_us: tuple[int, ...]) -> Event | None:
        return Event.ENGAGE if rc_us else None

    monkeypatch.setattr(RcSwitch, "update", standing)
    scenario = flight_with(Fault(at_s=9.0, kind="jump", word="", for_s=0.0, size=0.0))
    autopilot = dataclasses.replace(scenario.config.autopilot, engage_rc_channel=7)  # type: ignore[type-var]
    config = dataclasses.replace(scenario.config, autopilot=autopilot)
    faults = tuple(fault for fault in scenario.faults if fault.kind != "engage")
    assert "switch_seen_down" in broken_by(dataclasses.replace(scenario, config=config, faults=faults))


def _passes_everything(self: Gate, setpoint: Any, *_: Any, **__: Any) -> Verdict:
    return Verdict(setpoint)


@pytest.mark.long
def test_several_workers_fly_what_one_flies(tmp_path: Path) -> None:
    out = tmp_path / "missions.jsonl"
    command = [sys.executable, "-m", "tests.faults.missions", "--count", "4", "--jobs", "2", "--out", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = {row["seed"]: row for row in map(json.loads, out.read_text().splitlines())}
    assert sorted(rows) == [0, 1, 2, 3]
    assert rows[3]["setpoints"] == len(fly(draw(3)).of(Sent))
