"""What docs/safety.md promises, as rules over the trace of one mission. Each names what broke it, and when.

Limits are written here anew, not taken from the code that keeps them. `told` is what telemetry had said by then, which
is all the companion can go by; `really` is the mock autopilot's own state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from companion.core.clock import NS_PER_S
from companion.core.inputs import Event, Wish
from companion.core.messages import FlightMode, Vector3, VehicleState
from companion.flight.records import SERVICE_ENDS, MissionStep
from companion.mission.table import State
from companion.sim.px4.commander import Mode
from tests.faults.missions.trace import Asked, Failed, Moded, Sent, Served, Switched, Ticked, Trace, t_ns_of

_TICK_S: Final = 0.05
_SLACK_S: Final = 0.06
"""One tick, and what rounding adds."""
_STREAMING: Final = frozenset({State.TAKING_OFF, State.ACQUIRING, State.APPROACHING, State.HOLDING})
_IN_OFFBOARD: Final = _STREAMING - {State.TAKING_OFF}
_ASKING: Final = frozenset(
    {State.TAKING_OFF, State.ACQUIRING, State.APPROACHING, State.HOLDING, State.ARRIVED, State.LANDING}
)
_TOLD_AS: Final = {
    Mode.HOLD: FlightMode.HOLD, Mode.LAND: FlightMode.LAND, Mode.RTL: FlightMode.RETURN,
    Mode.OFFBOARD: FlightMode.OFFBOARD,
}  # fmt: skip
Found = Iterator[tuple[int, str]]


@dataclass(frozen=True, slots=True)
class Violation:
    promise: str
    t_s: float
    """Since the mission began."""
    what: str


def one_per_tick(trace: Trace) -> Found:
    """1. One set point per tick at most, and nothing repeats the last one between two ticks."""
    ticks, sent = 0, False
    for entry in trace.entries:
        if isinstance(entry, Ticked):
            ticks, sent = ticks + 1, False
        elif isinstance(entry, Sent):
            if sent:
                yield entry.t_ns, "a second set point within one tick"
            sent = True
            if not ticks:
                yield entry.t_ns, "a set point before the first tick"


def still_stream_is_over(trace: Trace) -> Found:
    """2. A stream that stood still for more than 0.5 s is over: no set point follows before a person engages."""
    last_ns: int | None = None
    for entry in trace.entries:
        if _is_engaged(entry) or isinstance(entry, Served):
            last_ns = None
        elif isinstance(entry, Sent):
            gap_s = 0.0 if last_ns is None else (entry.t_ns - last_ns) / NS_PER_S
            if gap_s > 0.5 + _SLACK_S:
                yield entry.t_ns, f"the stream went on after {gap_s:.2f} s of silence"
            last_ns = entry.t_ns


def lost_mode_is_left(trace: Trace) -> Found:
    """3. Once telemetry has told of a lost mode, neither set point nor command follows before a person engages."""
    lost, state = "", State.IDLE
    for entry in trace.entries:
        if _is_engaged(entry) or (isinstance(entry, Served) and entry.what == "begins"):
            lost = ""
        elif isinstance(entry, Ticked):
            if not lost and state in _IN_OFFBOARD and entry.told.mode not in (FlightMode.OFFBOARD, None):
                lost = f"{entry.told.mode} at {_s(trace, entry.t_ns):.2f} s"
        elif isinstance(entry, MissionStep):
            state = entry.next_state
        elif lost and isinstance(entry, Sent):
            yield entry.t_ns, f"a set point after the mode became {lost}"
        elif lost and isinstance(entry, Asked):
            yield entry.t_ns, f"{entry.what} {entry.wanted} asked for after the mode became {lost}"


def only_in_our_modes(trace: Trace) -> Found:
    """4. Set points go out in OFFBOARD and while the stream warms up only, by what is told, and by 1.6 s in truth."""
    left_ns: int | None = None
    for entry in trace.entries:
        if isinstance(entry, Moded):
            left_ns = None if entry.mode is Mode.OFFBOARD else entry.t_ns
        elif isinstance(entry, Sent):
            if entry.state not in _STREAMING:
                yield entry.t_ns, f"a set point in state {entry.state}"
            if entry.state is not State.TAKING_OFF and entry.told.mode is not FlightMode.OFFBOARD:
                yield entry.t_ns, f"a set point while the mode is told to be {entry.told.mode}"
            out_s = 0.0 if left_ns is None or entry.really is Mode.OFFBOARD else (entry.t_ns - left_ns) / NS_PER_S
            if entry.state is not State.TAKING_OFF and out_s > 1.5 + 2 * _SLACK_S:
                yield entry.t_ns, f"a set point {out_s:.2f} s after the mode really was lost"


def never_taken_back(trace: Trace) -> Found:
    """5. A set point or request of ours never brings an armed vehicle back into OFFBOARD before a person engages. (What
    PX4 does by itself, within COM_OF_LOSS_T of a set point that it had before, is its own.)"""
    engaged, was, spoke = False, False, False
    for entry in trace.entries:
        if _is_engaged(entry):
            engaged = True
        elif isinstance(entry, Served) and entry.what == "begins":
            engaged = False
        elif isinstance(entry, Sent) or (isinstance(entry, Asked) and _takes(entry)):
            spoke = True
        elif isinstance(entry, Moded):
            if entry.mode is Mode.OFFBOARD and entry.armed and not engaged and spoke:
                yield entry.t_ns, "we brought the vehicle into OFFBOARD, and nobody had engaged since it was left"
            if was and entry.mode is not Mode.OFFBOARD:
                engaged = spoke = False
            was = entry.mode is Mode.OFFBOARD


def within_limits(trace: Trace) -> Found:
    """6. Set points are finite, within fence, height, lead, speed, climb and acceleration, or hold in place."""
    gate = trace.scenario.config.gate
    for entry in trace.of(Sent):
        s, here, v = entry.setpoint, entry.told.p_local_enu_m, entry.told.v_local_enu_m_s
        if not s.is_finite() or here is None or v is None:
            yield entry.t_ns, f"{s} while the vehicle is at {here}"
            continue
        wanted = s.p_local_enu_m or tuple(p + 0.5 * d for p, d in zip(here, s.v_local_enu_m_s, strict=True))
        if math.dist(wanted, here) < 1e-6 and not any(s.v_local_enu_m_s):
            continue
        above = (wanted[0], wanted[1], wanted[2] - entry.ground_m)
        broken = {
            "box": not all(map(_is_between, gate.fence_min_m, above, gate.fence_max_m)),
            "cylinder": math.hypot(wanted[0], wanted[1]) > gate.fence_radius_m + 1e-9,
            "height": above[2] < gate.min_height_m - 1e-9,
            "lead": math.dist(wanted, here) > 2.0 + 1e-9,
            "speed": math.hypot(*s.v_local_enu_m_s[:2]) > gate.max_speed_m_s + 1e-9,
            "climb": abs(s.v_local_enu_m_s[2]) > gate.max_climb_m_s + 1e-9,
            "acceleration": math.dist(s.v_local_enu_m_s, v) > 0.5 * gate.max_acceleration_m_s2 + 1e-9,
            "neighbour": any(_closes_in(wanted, here, other, gate.min_neighbour_m) for other in entry.places),
        }  # fmt: skip
        for name in (name for name, is_so in broken.items() if is_so):
            yield entry.t_ns, f"outside the limit of {name}: {s}"


def fresh(trace: Trace) -> Found:
    """7. No set point by a position older than 0.5 s, or a heartbeat or mode older than 1.5 s."""
    for entry in trace.of(Sent):
        told = entry.told
        ages = {"position": (told.position_mono_ns, 0.5), "heartbeat": (told.heartbeat_mono_ns, 1.5)}
        ages["mode"] = told.mode_mono_ns, 1.5
        for name, (t_ns, most_s) in ages.items():
            age_s = math.inf if t_ns is None else (entry.t_ns - t_ns) / NS_PER_S
            if age_s > most_s + 1e-6:
                yield entry.t_ns, f"a set point by a {name} {age_s:.2f} s old"


def faults_end_the_stream(trace: Trace) -> Found:
    """8. No set point goes out at a tick whose battery is told to be low, or whose poses have been lost too long."""
    config = trace.scenario.config
    at: Ticked | None = None
    for entry in trace.entries:
        if isinstance(entry, Ticked):
            at = entry
        elif isinstance(entry, Sent) and at is not None:
            battery = at.told.battery_remaining
            if battery is not None and battery < config.mission.min_battery:
                yield entry.t_ns, f"a set point with the battery at {battery:.2f}"
            if at.pose_silent_s > config.pose_lost_s + _SLACK_S:
                yield entry.t_ns, f"a set point with poses silent for {at.pose_silent_s:.1f} s"


def person_engages(trace: Trace) -> Found:
    """9. Nothing is armed, taken off or asked into OFFBOARD unless a person has engaged since it last rested."""
    engaged = False
    for entry in trace.entries:
        if _is_engaged(entry):
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
        elif isinstance(entry, Asked) and not engaged and _takes(entry):
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
            "by an old look": entry.t_mono_ns - looked.t_ns > (0.5 + _SLACK_S) * NS_PER_S,
            "observing": config.mission.control == "observe",
            "no heartbeat": _age_s(told.heartbeat_mono_ns, looked.t_ns) > 2.0,
            "no position": _age_s(told.position_mono_ns, looked.t_ns) > 1.0 + _SLACK_S,
            "failsafe": told.failsafe,
            "flown by somebody": told.in_air and told.mode is not FlightMode.HOLD,
            "low battery": (1.0 if told.battery_remaining is None else told.battery_remaining)
            < config.mission.min_battery,
            "stale poses": looked.pose_silent_s > config.pose.stale_s + _SLACK_S,
            "no packets": looked.packet_s > config.aperture.silent_s + _SLACK_S,
            "no datagrams": looked.datagram_s > config.aperture.silent_s + _SLACK_S,
            "no worker": not looked.ready[0],
            "no recorder": not looked.ready[1],
            "clock not related": not looked.ready[2],
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
        elif _is_engaged(entry):
            aborted_ns = None
        elif aborted_ns is None or not isinstance(entry, Sent | Asked) or entry.t_ns - aborted_ns < _SLACK_S * NS_PER_S:
            continue
        elif isinstance(entry, Sent) or _takes(entry):
            yield entry.t_ns, f"{type(entry).__name__} {(entry.t_ns - aborted_ns) / NS_PER_S:.2f} s after an abort"


def asked_for_3_s(trace: Trace) -> Found:
    """13. A mode is asked for 3 s at most, and not again once the mode has changed to anything else."""
    first: Asked | None = None
    last_ns = 0
    for entry in trace.of(Asked):
        if entry.what != "mode":
            continue
        again = first is not None and entry.wanted is first.wanted and entry.t_ns - last_ns < 1.6 * NS_PER_S
        again = again and entry.told.mode is not _TOLD_AS.get(entry.wanted)  # it was had: this is asked for anew
        first = entry if not again or first is None else first
        last_ns = entry.t_ns
        if entry.t_ns - first.t_ns > 3.0 * NS_PER_S:
            yield entry.t_ns, f"{entry.wanted} asked for {(entry.t_ns - first.t_ns) / NS_PER_S:.1f} s on end"
        if entry.told.mode is not first.told.mode:
            yield entry.t_ns, f"{entry.wanted} asked for again after {first.told.mode} became {entry.told.mode}"


def restart_is_idle(trace: Trace) -> Found:
    """14. A service that begins is idle, and one that has ended says no more; one told to end in flight asks for
    hold or land within 0.5 s."""
    ended_ns, over, asked, must = 0, False, True, False
    for entry in trace.entries:
        if isinstance(entry, Served):
            match entry.what:
                case "begins":
                    over = False
                case "has ended":
                    if must and not asked:
                        yield ended_ns, "the service ended in flight and asked for nothing"
                    if must and entry.t_ns - ended_ns > 0.5 * NS_PER_S + _SLACK_S * NS_PER_S:
                        yield entry.t_ns, f"the end took {(entry.t_ns - ended_ns) / NS_PER_S:.2f} s"
                    over = True
                case how:
                    ended_ns, asked = entry.t_ns, False
                    must = how == "stop" and entry.was_flying and _is_ours(entry.told) and trace.quiet_ns < entry.t_ns
        elif isinstance(entry, Asked):
            asked |= entry.wanted in (Mode.HOLD, Mode.LAND)
            if over:
                yield entry.t_ns, f"{entry.what} after the service had ended"
        elif isinstance(entry, Sent) and over:
            yield entry.t_ns, "a set point after the service had ended"


def left_in_hold(trace: Trace) -> Found:
    """15. An end that leaves the vehicle leaves it: out of OFFBOARD within 3.5 s where the link is open."""
    since_ns: int | None = None
    for entry in trace.entries:
        if isinstance(entry, MissionStep) and entry.reason != SERVICE_ENDS:
            leaves = entry.state in _STREAMING and {"leave_to_hold", "land", "leave_at_target", "leave_without_target"}
            since_ns = entry.t_mono_ns if leaves and leaves & {str(action) for action in entry.actions} else None
        elif isinstance(entry, Served):
            since_ns = None
        elif isinstance(entry, Ticked) and since_ns is not None and trace.quiet_ns < since_ns - NS_PER_S:
            late, stays = entry.t_ns - since_ns > 3.5 * NS_PER_S, Mode.OFFBOARD in (entry.really, entry.intention)
            if late and stays and entry.armed:
                yield entry.t_ns, f"still in OFFBOARD {(entry.t_ns - since_ns) / NS_PER_S:.1f} s after it was left"
                since_ns = None


def observing_is_silent(trace: Trace) -> Found:
    """16. Who observes sends neither set points nor commands."""
    if trace.scenario.config.mission.control == "observe":
        for entry in trace.of(Sent, Asked):
            yield entry.t_ns, f"{type(entry).__name__} while observing"


def switch_seen_down(trace: Trace) -> Found:
    """17. The switch engages only when it was seen down before it went up, with RC all the while."""
    before: bool | None = False
    rose_ns = -math.inf
    for entry in trace.entries:
        if isinstance(entry, Switched):
            rose_ns = entry.t_ns if entry.up and before is False else rose_ns
            before = entry.up
        by_switch = isinstance(entry, Wish) and entry.by_switch and _is_engaged(entry)
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


def nothing_raises(trace: Trace) -> Found:
    """19. Nothing that happens to a flight makes one of its parts raise."""
    for entry in trace.of(Failed):
        yield entry.t_ns, entry.error


PROMISES: Final[tuple[Callable[[Trace], Found], ...]] = (
    one_per_tick, still_stream_is_over, lost_mode_is_left, only_in_our_modes, never_taken_back, within_limits, fresh,
    faults_end_the_stream, person_engages, preflight_holds, battery_is_known, abort_ends_it, asked_for_3_s,
    restart_is_idle, left_in_hold, observing_is_silent, switch_seen_down, latched_until_engaged, nothing_raises,
)  # fmt: skip


def violations(trace: Trace) -> list[Violation]:
    """The first of each promise."""
    found = []
    for promise in PROMISES:
        first = next(iter(promise(trace)), None)
        if first is not None:
            found.append(Violation(promise.__name__, round(_s(trace, first[0]), 3), first[1]))
    return found


def _s(trace: Trace, t_ns: int) -> float:
    return (t_ns - t_ns_of(trace.entries[0])) / NS_PER_S


def _age_s(t_ns: int | None, now_ns: int) -> float:
    return math.inf if t_ns is None else (now_ns - t_ns) / NS_PER_S


def _is_between(low: float, value: float, high: float) -> bool:
    return low - 1e-9 <= value <= high + 1e-9


def _is_engaged(entry: object) -> bool:
    return isinstance(entry, Wish) and entry.wish is Event.ENGAGE and not entry.refusal


def _takes(entry: Asked) -> bool:
    return entry.what in ("arm", "takeoff") or entry.wanted is Mode.OFFBOARD


def _is_ours(told: VehicleState | None) -> bool:
    return told is not None and told.mode in (FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD)


def _closes_in(wanted: Vector3, here: Vector3, other: Vector3, least_m: float) -> bool:
    return math.dist(wanted, other) < least_m - 1e-6 and math.dist(wanted, other) < math.dist(here, other) - 1e-6
