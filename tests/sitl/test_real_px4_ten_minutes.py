"""Ten minutes in the air on a real PX4, then home by itself: `python -m pytest -m px4 -s -k ten_minutes`."""

from __future__ import annotations

import asyncio
import itertools
import os
import signal
import time
from pathlib import Path
from typing import Final

import pytest

from companion.autopilot.telemetry import is_healthy
from companion.core.messages import FlightMode
from tests.sitl.real_cast import real_cast

pytestmark = pytest.mark.px4

_FLOWN_S: Final = 600.0
_MOVING_S: Final = 120.0
_OURS: Final = (FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD, FlightMode.RETURN)


async def test_it_flies_ten_minutes_and_returns_by_itself(tmp_path: Path) -> None:
    """Longer than TIMESYNC takes to converge, from when on PX4 believes the stamps of poses. First it moves, slowly;
    then the target falls silent, and in OFFBOARD it stands until the service lets PX4 return."""
    options = {"lost_target": "return", "speed_m_s": 0.1, "hold_limit_s": _FLOWN_S - _MOVING_S}
    async with real_cast(tmp_path, **options) as real:
        await real.fly()
        began_s = time.monotonic()
        await real.flight.in_state("approaching", timeout_s=90.0)
        await asyncio.sleep(began_s + _MOVING_S - time.monotonic())
        beacon = real.flight.cast.pid("beacon")
        os.kill(beacon, signal.SIGSTOP)
        try:
            await real.flight.in_state("holding", timeout_s=10.0)
            await real.flight.in_state("landing", timeout_s=_FLOWN_S + 60.0)
            ended_s = time.monotonic()
            await real.px4.down(120.0)
        finally:
            os.kill(beacon, signal.SIGCONT)
        sent_s = [t_s for t_s in real.px4.setpoints if began_s < t_s < ended_s]
        rate_hz = len(sent_s) / (ended_s - began_s)
        gap_s = max(after - before for before, after in itertools.pairwise(sent_s))
        east_m, north_m, up_m = real.px4.p_enu_m
        print(
            f"ten minutes: {ended_s - began_s:.0f} s in OFFBOARD, {rate_hz:.2f} set points/s, longest gap {gap_s:.3f} s"
        )
        print(f"ten minutes: landed East {east_m:.2f}, North {north_m:.2f}, Up {up_m:.2f} m of its start, in truth")
        flags = [flags for t_s, flags in real.px4.estimator if began_s < t_s < ended_s]
        modes = [mode for t_s, mode in real.px4.modes if began_s < t_s < ended_s + 5.0]
        assert ended_s - began_s > _FLOWN_S and rate_hz == pytest.approx(20.0, abs=0.5) and gap_s < 0.5
        assert set(modes) <= set(_OURS) and FlightMode.RETURN in modes
        assert flags and all(is_healthy(one, in_air=True) for one in flags)
        assert max(abs(east_m), abs(north_m)) < 3.0
