"""What the vehicle tells reaches the log, the apertures and North, and nothing that is old turns North."""

from __future__ import annotations

from typing import Any

from companion.core.clock import NS_PER_S
from companion.core.messages import AutopilotEvent, Vector3, VehicleState
from companion.core.streams import AUTOPILOT_EVENT
from companion.flight.vehicle_feed import VehicleFeed
from tests.kept import Kept

_NOW_NS = 10 * NS_PER_S
_SAID = AutopilotEvent(_NOW_NS - 7, 4, "Preflight Fail: compass")


class _All:
    """The autopilot, and all who are told; it keeps what they were told."""

    def __init__(self, vehicle: VehicleState) -> None:
        self.vehicle = vehicle
        self.events = [_SAID]
        self.told: list[tuple[Any, ...]] = []

    def state(self) -> VehicleState:
        return self.vehicle

    def take_events(self) -> list[AutopilotEvent]:
        events, self.events = self.events, []
        return events

    def add_local_position(self, t_ns: int, p_m: Vector3) -> None:
        self.told.append(("position", t_ns, p_m))

    def add_heading(self, t_ns: int, yaw_rad: float) -> None:
        self.told.append(("heading", t_ns, yaw_rad))


def _told(vehicle: VehicleState) -> tuple[list[tuple[Any, ...]], Kept]:
    world, kept = _All(vehicle), Kept()
    feed = VehicleFeed(world, world, world, kept)  # type: ignore[arg-type]
    assert feed.take(_NOW_NS) is vehicle
    return world.told, kept


def test_all_of_it_is_handed_on_with_its_own_times() -> None:
    t_ns = _NOW_NS - NS_PER_S // 4
    told, kept = _told(
        VehicleState(t_mono_ns=_NOW_NS, position_mono_ns=t_ns, p_local_enu_m=(1.0, 2.0, 3.0), yaw_enu_rad=0.5)
    )
    assert told == [("position", t_ns, (1.0, 2.0, 3.0)), ("heading", _NOW_NS, 0.5)]
    assert kept.messages == [(AUTOPILOT_EVENT, _SAID.t_mono_ns, _SAID)]


def test_the_heading_of_a_vehicle_that_is_silent_turns_no_north() -> None:
    t_ns = _NOW_NS - NS_PER_S
    told, _ = _told(
        VehicleState(t_mono_ns=_NOW_NS, position_mono_ns=t_ns, p_local_enu_m=(1.0, 2.0, 3.0), yaw_enu_rad=0.5)
    )
    assert [what for what, *_ in told] == ["position"]
    assert _told(VehicleState(t_mono_ns=_NOW_NS, yaw_enu_rad=0.5))[0] == []
