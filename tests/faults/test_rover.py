"""A rover's whole mission in virtual time: the service's own parts and the mock PX4 on wheels."""

from __future__ import annotations

import functools
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import pytest

from companion.mission.table import State
from companion.sim.stage import Stage, set_stage
from tests.faults import virtual_flight
from tests.faults.virtual_flight import VirtualFlight
from tests.unit.companion.autopilot.virtual_vehicle import VirtualVehicle


def _stage(directory: Path, out: Path, seed: int, use_netlink: bool, gps: bool) -> Stage:
    stage = set_stage(directory, out, seed=seed, use_netlink=use_netlink, gps=gps)
    mission = replace(stage.uav.mission, vehicle="rover", acceleration_m_s2=0.4, lost_target="land")
    return replace(stage, uav=replace(stage.uav, mission=mission))


@pytest.fixture
async def flight(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[VirtualFlight]:
    monkeypatch.setattr(virtual_flight, "set_stage", _stage)
    monkeypatch.setattr(virtual_flight, "VirtualVehicle", functools.partial(VirtualVehicle, vehicle="rover"))
    flown = VirtualFlight(directory=tmp_path_factory.mktemp("v"), out=tmp_path, monkeypatch=monkeypatch, gps=False)
    try:
        async with flown.flight._commands:
            await flown.run(2.0)
            yield flown
            flown.flight._commands.cancel()  # after a failure nobody moves its clock on
    finally:
        flown.close()


async def test_a_rover_drives_stands_and_is_disarmed_and_nothing_takes_off(flight: VirtualFlight) -> None:
    assert flight.flight.status()["not_ready"] == []
    assert await flight.engage() == ""
    await flight.until(State.APPROACHING)
    assert flight.state.autopilot == "px4 on a ground rover" and flight.report().mode == "OFFBOARD"
    await flight.run(6.0)
    assert max(abs(p[2]) for p, _ in flight.truths) == 0.0 and flight.top_speed_m_s(0) > 0.2
    flight.is_heard = False
    await flight.until(State.HOLDING, timeout_s=5.0)
    await flight.run(2.0)
    stood = len(flight.truths)
    yaw_rad = flight.px4.commander.airframe.yaw_enu_rad
    await flight.run(1.0)
    assert flight.top_speed_m_s(stood) < 0.02
    assert flight.px4.commander.airframe.yaw_enu_rad == pytest.approx(yaw_rad, abs=0.02), "it does not turn to North"
    await flight.until(State.IDLE, timeout_s=30.0)
    assert State.LANDING in flight.states and State.LATCHED not in flight.states
    await flight.run(5.0)
    report = flight.report()
    assert not report.armed and report.mode == "HOLD"
    asked = flight.px4.link.received
    assert "COMMAND_LONG 22" not in asked and "PARAM_SET" not in asked, "no takeoff, and no height for one"


async def test_an_abort_leaves_a_rover_in_hold_where_it_is(flight: VirtualFlight) -> None:
    assert await flight.engage() == ""
    await flight.until(State.ACQUIRING)
    await flight.run(2.0)
    flight.flight.wishes.abort()
    await flight.until(State.LATCHED, timeout_s=0.2)
    await flight.run(2.0)
    assert flight.report().mode == "HOLD" and flight.px4.commander.armed


async def test_a_rover_in_a_pilots_mode_is_not_armed(flight: VirtualFlight) -> None:
    flight.order("pilot MANUAL")
    await flight.run(1.0)
    assert "in which it would be armed" in await flight.engage()
    assert not flight.px4.commander.armed
