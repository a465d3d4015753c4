"""What must be so before the vehicle is taken, and who may say so: promises 9, 10, 11, 12, 17 and 18."""

from __future__ import annotations

import math

from companion.core.clock import NS_PER_S, age_s
from companion.core.inputs import Event, Wish
from companion.core.messages import FlightMode
from companion.flight.records import MissionStep
from companion.mission.table import State
from tests.faults.missions.promises.rule import SLACK_S, Found, is_engaged, takes_vehicle
from tests.faults.missions.trace import Asked, Sent, Served, Switched, Ticked, Trace, t_ns_of


def person_engages(trace: Trace) -> Found:
    """9. Nothing is armed, taken off or asked into OFFBOARD unless a person has engaged since it last rested."""
    engaged = False
    for entry in trace.entries:
        if is_engaged(entry):
            engaged = True
        elif isinstance(entry, Served) and entry.what == "begins":
            engaged = False
        elif isinstance(entry, MissionStep):
            if entry.next_state in (State.IDLE, State.LATCHED, State.FAULT):
                engaged = False
            if entry.next_state is State.PREFLIGHT and not (engaged and entry.event is Event.ENGAGE):
                yield entry.t_mono_ns, f"preflight begun by {entry.event}, and nobody had engaged"
        elif isinstance(entry, Sent) and not engaged:
            yield entry.t_ns, "a set point, and nobody had engaged"
        elif isinstance(entry, Asked) and not engaged and takes_vehicle(entry):
            yield entry.t_ns, f"{entry.what} {entry.wanted} asked for, and nobody had engaged"


def preflight_holds(trace: Trace) -> Found:
    """10. What the preflight passes is as it should be when it looks: link, poses, target, worker, recorder, mode; and
    what comes of that look does so within 0.5 s."""
    config = trace.scenario.config
    at: Ticked | None = None
    looked: Ticked | None = None
    for entry in trace.entries:
        if isinstance(entry, Ticked):
            at = entry
        if not isinstance(entry, MissionStep):
            continue
        if entry.next_state is State.PREFLIGHT and entry.state is not State.PREFLIGHT:
            looked = at
        if entry.event is not Event.PREFLIGHT_PASSED or looked is None:
            continue
        told = looked.told
        wrong = {
            "by an old look": entry.t_mono_ns - looked.t_ns > (0.5 + SLACK_S) * NS_PER_S,
            "observing": config.mission.control == "observe",
            "no heartbeat": age_s(told.heartbeat_mono_ns, looked.t_ns) > 2.0,
            "no position": age_s(told.position_mono_ns, looked.t_ns) > 1.0 + SLACK_S,
            "failsafe": told.failsafe,
            "flown by somebody": told.in_air and told.mode is not FlightMode.HOLD,
            "low battery": (1.0 if told.battery_remaining is None else told.battery_remaining)
            < config.mission.min_battery,
            "stale poses": looked.pose_silent_s > config.pose.stale_s + SLACK_S,
            "no packets": looked.packet_s > config.aperture.silent_s + SLACK_S,
            "no datagrams": looked.datagram_s > config.aperture.silent_s + SLACK_S,
            "no worker": not looked.ready[0],
            "no recorder": not looked.ready[1],
            "clock not related": not looked.ready[2],
            "arming checks fail, or nothing is told of them": not told.armed and not looked.ready[4],
            "stream lost means nothing good": trace.scenario.rc_loss_act not in (4, 5),
        }
        for name in (name for name, is_so in wrong.items() if is_so):
            yield entry.t_mono_ns, f"the preflight passed: {name}"


def battery_is_known(trace: Trace) -> Found:
    """11. Nothing engages on a battery that tells nothing."""
    at: Ticked | None = None
    for entry in trace.entries:
        if isinstance(entry, Ticked):
            at = entry
        passed = isinstance(entry, MissionStep) and entry.event is Event.PREFLIGHT_PASSED
        if passed and at is not None and at.told.battery_remaining is None:
            yield t_ns_of(entry), "the preflight passed with an unknown battery"


def abort_ends_it(trace: Trace) -> Found:
    """12. An abort ends an engagement at the next tick: no set point after it, and nothing that takes the vehicle."""
    aborted_ns: int | None = None
    for entry in trace.entries:
        if isinstance(entry, Wish) and entry.wish is Event.ABORT:
            aborted_ns = entry.t_mono_ns
        elif is_engaged(entry):
            aborted_ns = None
        elif aborted_ns is None or not isinstance(entry, Sent | Asked) or entry.t_ns - aborted_ns < SLACK_S * NS_PER_S:
            continue
        elif isinstance(entry, Sent) or takes_vehicle(entry):
            yield entry.t_ns, f"{type(entry).__name__} {(entry.t_ns - aborted_ns) / NS_PER_S:.2f} s after an abort"


def switch_seen_down(trace: Trace) -> Found:
    """17. The switch engages only when it was seen down before it went up, with RC all the while."""
    before: bool | None = False
    rose_ns = -math.inf
    for entry in trace.entries:
        if isinstance(entry, Switched):
            rose_ns = entry.t_ns if entry.up and before is False else rose_ns
            before = entry.up
        by_switch = isinstance(entry, Wish) and entry.by_switch and is_engaged(entry)
        if by_switch and t_ns_of(entry) - rose_ns > 5 * NS_PER_S:
            yield t_ns_of(entry), "engaged by a switch that nobody moved up"


def latched_until_engaged(trace: Trace) -> Found:
    """18. Latched is left by a person's engage alone, fault by nothing; between two steps the state stays."""
    state = State.IDLE
    for entry in trace.entries:
        if isinstance(entry, Served) and entry.what == "begins":
            state = State.IDLE
        if not isinstance(entry, MissionStep):
            continue
        if entry.state is not state:
            yield entry.t_mono_ns, f"the state was {state} and is {entry.state}"
        leaves = entry.state is State.LATCHED and entry.next_state not in (State.LATCHED, State.FAULT)
        if leaves and entry.event is not Event.ENGAGE:
            yield entry.t_mono_ns, f"latched left by {entry.event}"
        if entry.state is State.FAULT and entry.next_state is not State.FAULT:
            yield entry.t_mono_ns, f"fault left by {entry.event}"
        state = entry.next_state
