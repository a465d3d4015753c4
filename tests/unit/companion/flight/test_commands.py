"""How the vehicle is left when the service ends in flight."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode, VehicleState
from companion.flight.commands import FlightCommands
from tests.manual_clock import ManualClock

_NOW_NS = 100 * NS_PER_S
_FLYING = VehicleState(
    t_mono_ns=_NOW_NS,
    heartbeat_mono_ns=_NOW_NS,
    mode=FlightMode.OFFBOARD,
    mode_mono_ns=_NOW_NS,
    armed=True,
    in_air=True,
)
_PLACED = replace(_FLYING, p_local_enu_m=(0.0, 0.0, 1.5), position_mono_ns=_NOW_NS)


class _Autopilot:
    """Notes what it is commanded."""

    def __init__(self, state: VehicleState, refuses: bool = False) -> None:
        self._state = state
        self._refuses = refuses
        self.commanded: list[str] = []

    def state(self) -> VehicleState:
        return self._state

    async def hold(self) -> None:
        self.commanded.append("hold")
        if self._refuses:
            raise AutopilotError("no")

    async def land(self) -> None:
        self.commanded.append("land")

    async def return_home(self) -> None:
        self.commanded.append("return")


async def _left(state: VehicleState, refuses: bool = False) -> list[str]:
    autopilot = _Autopilot(state, refuses)
    await FlightCommands(autopilot, ManualClock(), lambda *_: None).leave_at_end()  # type: ignore[arg-type]
    return autopilot.commanded


@pytest.mark.parametrize("mode", [FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD])
async def test_it_is_left_in_hold_or_landing_where_it_has_no_place(mode: FlightMode) -> None:
    assert await _left(replace(_PLACED, mode=mode)) == ["hold"]
    assert await _left(replace(_FLYING, mode=mode)) == ["land"]
    assert await _left(replace(_PLACED, mode=mode, position_mono_ns=_NOW_NS - NS_PER_S)) == ["land"]


async def test_where_hold_is_refused_it_lands() -> None:
    assert await _left(_PLACED, refuses=True) == ["hold", "land"]


@pytest.mark.parametrize("mode", sorted(set(FlightMode) - {FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.HOLD}))
async def test_a_mode_that_somebody_took_since_the_last_tick_stays_theirs(mode: FlightMode) -> None:
    """The loop may have stood still for long before it failed: a pilot who took over then is obeyed."""
    assert await _left(replace(_PLACED, mode=mode)) == []


async def test_it_returns_only_by_a_way_home_that_is_still_right() -> None:
    async def is_right() -> list[str]:
        return []

    async def is_high() -> list[str]:
        return ["parameter RTL_RETURN_ALT is 30"]

    async def is_silent() -> list[str]:
        await asyncio.sleep(60.0)
        return []

    for look, commanded in ((is_right, "return"), (is_high, "land"), (is_silent, "land")):
        autopilot = _Autopilot(_PLACED)
        await FlightCommands(autopilot, ManualClock(), lambda *_: None).return_home(look)  # type: ignore[arg-type]
        assert autopilot.commanded == [commanded]


class _Landing(_Autopilot):
    """Disarms after some looks at it, and is then in a mode of its own."""

    def __init__(self, mode: FlightMode, intended: FlightMode | None = None) -> None:
        super().__init__(replace(_PLACED, mode=FlightMode.LAND, in_air=False))
        self._then = replace(self._state, armed=False, mode=mode, intended_mode=intended)
        self._looks = 0

    def state(self) -> VehicleState:
        self._looks += 1
        return self._state if self._looks < 20 else self._then


@pytest.mark.parametrize(
    ("landing", "commanded"),
    [
        (_Landing(FlightMode.OFFBOARD), ["hold"]),
        (_Landing(FlightMode.HOLD, FlightMode.OFFBOARD), ["hold"]),
        (_Landing(FlightMode.HOLD), []),
        (_Landing(FlightMode.MANUAL), []),
    ],
)
async def test_after_a_landing_offboard_is_left_once_it_has_disarmed(landing: _Landing, commanded: list[str]) -> None:
    clock = ManualClock()
    await FlightCommands(landing, clock, lambda *_: None).leave_on_the_ground()  # type: ignore[arg-type]
    assert landing.commanded == commanded and clock.now_ns() >= 1.9 * NS_PER_S


@pytest.mark.parametrize("armed", [False, True])
async def test_a_rover_is_armed_and_nothing_else(armed: bool) -> None:
    autopilot = _Arming(replace(_FLYING, armed=armed))
    await FlightCommands(autopilot, ManualClock(_NOW_NS), lambda event, reason: None).arm()  # type: ignore[arg-type]
    assert autopilot.commanded == ([] if armed else ["arm"])


class _Arming(_Autopilot):
    async def arm(self) -> None:
        self.commanded.append("arm")
