"""Modes that are lost, asked for and left: promises 3, 5, 13 and 15."""

from __future__ import annotations

from typing import Final

from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode
from companion.flight.records import SERVICE_ENDS, MissionStep
from companion.mission.table import State
from companion.sim.px4.commander import Mode
from tests.faults.missions.promises.rule import STREAMING, Found, is_engaged, since_start_s, takes_vehicle
from tests.faults.missions.trace import Asked, Moded, Sent, Served, Ticked, Trace

_IN_OFFBOARD: Final = STREAMING - {State.TAKING_OFF}
_TOLD_AS: Final = {
    Mode.HOLD: FlightMode.HOLD, Mode.LAND: FlightMode.LAND, Mode.RTL: FlightMode.RETURN,
    Mode.OFFBOARD: FlightMode.OFFBOARD,
}  # fmt: skip


def lost_mode_is_left(trace: Trace) -> Found:
    """3. Once telemetry has told of a lost mode, neither set point nor command follows before a person engages."""
    lost, state = "", State.IDLE
    for entry in trace.entries:
        if is_engaged(entry) or (isinstance(entry, Served) and entry.what == "begins"):
            lost = ""
        elif isinstance(entry, Ticked):
            if not lost and state in _IN_OFFBOARD and entry.told.mode not in (FlightMode.OFFBOARD, None):
                lost = f"{entry.told.mode} at {since_start_s(trace, entry.t_ns):.2f} s"
        elif isinstance(entry, MissionStep):
            state = entry.next_state
        elif lost and isinstance(entry, Sent):
            yield entry.t_ns, f"a set point after the mode became {lost}"
        elif lost and isinstance(entry, Asked):
            yield entry.t_ns, f"{entry.what} {entry.wanted} asked for after the mode became {lost}"


def never_taken_back(trace: Trace) -> Found:
    """5. A set point or request of ours never brings an armed vehicle back into OFFBOARD before a person engages. (What
    PX4 does by itself, within COM_OF_LOSS_T of a set point that it had before, is its own.)"""
    engaged, was, spoke = False, False, False
    for entry in trace.entries:
        if is_engaged(entry):
            engaged = True
        elif isinstance(entry, Served) and entry.what == "begins":
            engaged = False
        elif isinstance(entry, Sent) or (isinstance(entry, Asked) and takes_vehicle(entry)):
            spoke = True
        elif isinstance(entry, Moded):
            if entry.mode is Mode.OFFBOARD and entry.armed and not engaged and spoke:
                yield entry.t_ns, "we brought the vehicle into OFFBOARD, and nobody had engaged since it was left"
            if was and entry.mode is not Mode.OFFBOARD:
                engaged = spoke = False
            was = entry.mode is Mode.OFFBOARD


def asked_for_3_s(trace: Trace) -> Found:
    """13. A mode is asked for 3 s at most, and not again once the mode has changed to anything else."""
    first: Asked | None = None
    last_ns = 0
    for entry in trace.entries:
        if is_engaged(entry):
            first = None  # what is asked for next is another wish
        if not isinstance(entry, Asked) or entry.wanted is None:
            continue
        again = first is not None and entry.wanted is first.wanted and entry.t_ns - last_ns < 1.6 * NS_PER_S
        again = again and entry.told.mode is not _TOLD_AS.get(entry.wanted)  # it was had: this is asked for anew
        first = entry if not again or first is None else first
        last_ns = entry.t_ns
        if entry.t_ns - first.t_ns > 3.0 * NS_PER_S:
            yield entry.t_ns, f"{entry.wanted} asked for {(entry.t_ns - first.t_ns) / NS_PER_S:.1f} s on end"
        if entry.told.mode is not first.told.mode:
            yield entry.t_ns, f"{entry.wanted} asked for again after {first.told.mode} became {entry.told.mode}"


def left_in_hold(trace: Trace) -> Found:
    """15. An end that leaves the vehicle leaves it: out of OFFBOARD within 3.5 s where the link is open."""
    since_ns: int | None = None
    for entry in trace.entries:
        if isinstance(entry, MissionStep) and entry.reason != SERVICE_ENDS:
            leaves = entry.state in STREAMING and {"leave_to_hold", "land", "leave_at_target", "leave_without_target"}
            since_ns = entry.t_mono_ns if leaves and leaves & {str(action) for action in entry.actions} else None
        elif isinstance(entry, Served):
            since_ns = None
        elif isinstance(entry, Ticked) and since_ns is not None and trace.quiet_ns < since_ns - NS_PER_S:
            late, stays = entry.t_ns - since_ns > 3.5 * NS_PER_S, Mode.OFFBOARD in (entry.really, entry.intention)
            if late and stays and entry.armed:
                yield entry.t_ns, f"still in OFFBOARD {(entry.t_ns - since_ns) / NS_PER_S:.1f} s after it was left"
                since_ns = None
