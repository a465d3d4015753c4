"""When set points may go out, and which: promises 1, 2, 4, 6, 7, 8 and 16."""

from __future__ import annotations

import math

from companion.core.clock import NS_PER_S, age_s
from companion.core.messages import FlightMode, Vector3
from companion.mission.conditions import BATTERY_UNKNOWN_S
from companion.mission.table import State
from companion.sim.px4.commander import Mode
from tests.faults.missions.promises.rule import SLACK_S, STREAMING, Found, is_engaged
from tests.faults.missions.trace import Asked, Moded, Sent, Served, Ticked, Trace


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
        if is_engaged(entry) or isinstance(entry, Served):
            last_ns = None
        elif isinstance(entry, Sent):
            gap_s = 0.0 if last_ns is None else (entry.t_ns - last_ns) / NS_PER_S
            if gap_s > 0.5 + SLACK_S:
                yield entry.t_ns, f"the stream went on after {gap_s:.2f} s of silence"
            last_ns = entry.t_ns


def only_in_our_modes(trace: Trace) -> Found:
    """4. Set points go out in OFFBOARD and while the stream warms up only, by what is told, and by 1.6 s in truth."""
    left_ns: int | None = None
    for entry in trace.entries:
        if isinstance(entry, Moded):
            left_ns = None if entry.mode is Mode.OFFBOARD else entry.t_ns
        elif isinstance(entry, Sent):
            if entry.state not in STREAMING:
                yield entry.t_ns, f"a set point in state {entry.state}"
            if entry.state is not State.TAKING_OFF and entry.told.mode is not FlightMode.OFFBOARD:
                yield entry.t_ns, f"a set point while the mode is told to be {entry.told.mode}"
            out_s = 0.0 if left_ns is None or entry.really is Mode.OFFBOARD else (entry.t_ns - left_ns) / NS_PER_S
            if entry.state is not State.TAKING_OFF and out_s > 1.5 + 2 * SLACK_S:
                yield entry.t_ns, f"a set point {out_s:.2f} s after the mode really was lost"


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
            old_s = age_s(t_ns, entry.t_ns)
            if old_s > most_s + 1e-6:
                yield entry.t_ns, f"a set point by a {name} {old_s:.2f} s old"


def faults_end_the_stream(trace: Trace) -> Found:
    """8. No set point goes out at a tick whose battery is told to be low, or has told nothing for too long, or whose
    poses have been lost too long."""
    config = trace.scenario.config
    at: Ticked | None = None
    known_ns = 0
    for entry in trace.entries:
        if isinstance(entry, Ticked):
            at = entry
            if at.told.battery_remaining is not None and not at.told.batteries_unknown:
                known_ns = at.t_ns
        elif isinstance(entry, Sent) and at is not None:
            battery = at.told.battery_remaining
            if battery is not None and battery < config.mission.min_battery:
                yield entry.t_ns, f"a set point with the battery at {battery:.2f}"
            if (unknown_s := age_s(known_ns, entry.t_ns)) > BATTERY_UNKNOWN_S + SLACK_S:
                yield entry.t_ns, f"a set point with a battery that has told nothing for {unknown_s:.1f} s"
            if at.pose_silent_s > config.pose_lost_s + SLACK_S:
                yield entry.t_ns, f"a set point with poses silent for {at.pose_silent_s:.1f} s"


def observing_is_silent(trace: Trace) -> Found:
    """16. Who observes sends neither set points nor commands."""
    if trace.scenario.config.mission.control == "observe":
        for entry in trace.of(Sent, Asked):
            yield entry.t_ns, f"{type(entry).__name__} while observing"


def _is_between(low: float, value: float, high: float) -> bool:
    return low - 1e-9 <= value <= high + 1e-9


def _closes_in(wanted: Vector3, here: Vector3, other: Vector3, least_m: float) -> bool:
    return math.dist(wanted, other) < least_m - 1e-6 and math.dist(wanted, other) < math.dist(here, other) - 1e-6
