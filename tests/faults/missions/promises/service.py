"""How the service begins, ends and fails: promises 14 and 19."""

from __future__ import annotations

from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode, VehicleState
from companion.sim.px4.commander import Mode
from tests.faults.missions.promises.rule import SLACK_S, Found
from tests.faults.missions.trace import Asked, Failed, Sent, Served, Trace


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
                    if must and entry.t_ns - ended_ns > 0.5 * NS_PER_S + SLACK_S * NS_PER_S:
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


def nothing_raises(trace: Trace) -> Found:
    """19. Nothing that happens to a flight makes one of its parts raise."""
    for entry in trace.of(Failed):
        yield entry.t_ns, entry.error


def _is_ours(told: VehicleState | None) -> bool:
    return told is not None and told.mode in (FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD)
