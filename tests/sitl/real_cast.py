"""The service on a real PX4 that somebody has started, and what its tests do to both."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import pytest
from pymavlink.dialects.v20 import development as mavlink

from companion.autopilot.px4_modes import HOLD, LAND
from companion.core.messages import FlightMode
from tests.sitl.flying import IN_OFFBOARD, Flying, flying
from tests.sitl.real_px4 import RealPx4, file_parameters, why_no_px4

_FILES: Final = Path(__file__).resolve().parents[2] / "configs" / "px4"
RESTART: Final = "COMPANION_PX4_RESTART"
"""Environment: a shell command that kills PX4, and starts it again with the parameters it had."""


@dataclass(frozen=True, slots=True)
class Real:
    """The vehicle, and the cast that flies it."""

    px4: RealPx4
    flight: Flying
    gps: bool

    @property
    def left_to(self) -> FlightMode:
        """The mode PX4 takes by itself when the stream is lost: COM_OBL_RC_ACT of the parameter file."""
        return FlightMode.HOLD if self.gps else FlightMode.LAND

    async def fly(self) -> None:
        """In OFFBOARD by the service, in the air."""
        state = (await self.flight.until(lambda status: True))["state"]
        if state not in (*IN_OFFBOARD, "idle", "latched"):
            await self.flight.let_go()
        if state not in IN_OFFBOARD:
            await self.settle()
            await self.flight.engage(timeout_s=120.0)
        await self.flight.in_state(*IN_OFFBOARD, timeout_s=60.0)
        await self.px4.in_mode(FlightMode.OFFBOARD, timeout_s=5.0)
        await asyncio.sleep(1.0)

    async def settle(self) -> None:
        """Hold, chosen by a person; what comes down is let down first."""
        if self.px4.mode is FlightMode.LAND:
            await self.px4.down()
        assert await self.px4.choose(*HOLD) == mavlink.MAV_RESULT_ACCEPTED
        await self.px4.in_mode(FlightMode.HOLD, timeout_s=5.0)

    async def land(self) -> None:
        """By a person."""
        await self.settle()
        assert await self.px4.choose(*LAND) == mavlink.MAV_RESULT_ACCEPTED
        await self.px4.down()
        await self.settle()

    async def never_back(self, after_s: float, for_s: float = 3.0) -> None:
        """Out of OFFBOARD now, and for some time in the air; no set point since `after_s` [s, monotonic]."""
        from_s = time.monotonic()
        await asyncio.sleep(for_s)
        late_s = self.px4.setpoints_after(after_s)
        assert not late_s, f"{len(late_s)} set points after {after_s:.3f} s: {late_s[:5]} ..."
        assert not any(t_s > from_s for t_s in self.px4.offboard_in_air)
        assert self.px4.mode is not FlightMode.OFFBOARD or self.px4.landed

    async def restart(self) -> None:
        """As after a loss of power: PX4 begins anew, on the ground at its start. Skips where nobody said how."""
        command = os.environ.get(RESTART)
        if not command:
            answer = await self.px4.command(mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
            if answer != mavlink.MAV_RESULT_ACCEPTED:
                pytest.skip(f"PX4 refuses to reboot (MAV_RESULT {answer}), and {RESTART} names no command")
        else:
            process = await asyncio.create_subprocess_shell(command)
            assert await process.wait() == 0, command
        await self.px4.until("started again", lambda: bool(self.px4.started), 30.0)
        self.px4.feed(self.flight.stage.scenario.truth_in)


@asynccontextmanager
async def real_cast(out: Path, **mission: Any) -> AsyncIterator[Real]:
    """PX4 with the parameters of `configs/px4`, and a cast for it; `mission` as of `flying`. Skips without a PX4."""
    if reason := await asyncio.to_thread(why_no_px4):
        pytest.skip(reason)
    with RealPx4() as px4:
        await px4.until("there", lambda: {"HEARTBEAT", "EXTENDED_SYS_STATE"} <= px4.told.keys(), 10.0)
        gps = await px4.parameter("SYS_HAS_GPS") == 1
        for name, value in file_parameters(_FILES / ("gps.params" if gps else "gps-denied.params")).items():
            if name != "EKF2_EV_DELAY":  # the simulated camera has none
                await px4.set(name, value)
        autopilot: dict[str, Any] = {} if gps else {"gps": False, "forward_vio_hz": 50.0}
        url = f"udpin://127.0.0.1:{px4.service_port}"
        async with flying(out, real_url=url, autopilot=autopilot, **mission) as flight:
            px4.feed(flight.stage.scenario.truth_in)
            try:
                yield Real(px4, flight, gps)
            finally:
                px4.is_cut = False
                if px4.armed:
                    await px4.choose(*LAND)
                    await px4.down()
