"""The vehicle flown over the edge: set points in ENU, OFFBOARD asked for, a pilot given way to."""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S, MonotonicClock, Ticker
from companion.core.messages import FlightMode, Setpoint
from tests.sitl.px4_process import Px4Process

_CLOCK = MonotonicClock()


@contextlib.asynccontextmanager
async def _streaming(autopilot: MavsdkAutopilot, v_enu_m_s: tuple[float, float, float]) -> AsyncIterator[None]:
    """A 20 Hz stream of set points that start where the vehicle is and move with `v_enu_m_s`."""
    start_m, start_ns = autopilot.state().p_local_enu_m, _CLOCK.now_ns()
    assert start_m is not None

    async def stream() -> None:
        async for now_ns in Ticker(_CLOCK, 20).ticks():
            t_s = (now_ns - start_ns) / NS_PER_S
            x, y, z = (p + v * t_s for p, v in zip(start_m, v_enu_m_s, strict=True))
            autopilot.send_setpoint(Setpoint(now_ns, (x, y, z), v_enu_m_s, 1.0))

    task = asyncio.create_task(stream())
    await asyncio.sleep(0.3)
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def _fly(autopilot: MavsdkAutopilot) -> None:
    await autopilot.arm()
    await autopilot.takeoff(1.5)


async def test_a_whole_flight(autopilot: MavsdkAutopilot, px4: Px4Process) -> None:
    await _fly(autopilot)
    hovering = autopilot.state()
    assert hovering.mode is FlightMode.HOLD and hovering.armed and hovering.in_air
    assert hovering.p_local_enu_m is not None and abs(hovering.p_local_enu_m[2] - 1.5) < 0.3
    assert hovering.battery_remaining == pytest.approx(0.95)

    async with _streaming(autopilot, (0.5, 0.3, 0.1)):
        await autopilot.request_offboard()
        began_ns = _CLOCK.now_ns()
        await asyncio.sleep(4)
        flown = autopilot.state()
        truth = px4.report()
        assert flown.mode is FlightMode.OFFBOARD and truth.mode == "OFFBOARD"
        rate_hz = truth.setpoints_in_offboard / truth.offboard_s
        print(f"{rate_hz:.2f} set points/s in OFFBOARD, largest gap {1000 * truth.largest_gap_s:.0f} ms")
        assert 18 <= rate_hz <= 22
        assert truth.largest_gap_s < 0.5, "beyond which PX4 leaves OFFBOARD; fault 5 is about gaps under load"
        # East, North, Up and the yaw arrive as they were sent, though NED was spoken on the wire.
        elapsed_s = (_CLOCK.now_ns() - began_ns) / NS_PER_S
        assert truth.v_enu_m_s == pytest.approx((0.5, 0.3, 0.1), abs=0.05)
        assert flown.p_local_enu_m == pytest.approx(truth.p_enu_m, abs=0.1)
        assert flown.v_local_enu_m_s == pytest.approx(truth.v_enu_m_s, abs=0.05)
        assert truth.p_enu_m[0] == pytest.approx(0.5 * elapsed_s, abs=0.5)
        assert flown.yaw_enu_rad == pytest.approx(1.0, abs=0.02)
        assert truth.yaw_enu_rad == pytest.approx(1.0, abs=0.02)
        await autopilot.hold()
        assert autopilot.state().mode is FlightMode.HOLD
        await autopilot.request_offboard()

    # PX4 would go back to OFFBOARD after a landing straight out of it; the edge leaves the mode on the way.
    assert autopilot.state().mode is FlightMode.OFFBOARD
    await autopilot.land()
    assert autopilot.state().mode is FlightMode.LAND
    landed = await asyncio.to_thread(px4.wait_until, lambda report: not report.armed, 15.0)
    assert landed.landed and landed.mode == "HOLD" and landed.largest_gap_s < 0.5
    assert landed.timesync_answers > 0 and landed.peer_heartbeats > 0


async def test_a_set_point_is_sent_once_and_never_when_not_a_number(
    autopilot: MavsdkAutopilot, px4: Px4Process
) -> None:
    for _ in range(10):
        autopilot.send_setpoint(Setpoint(_CLOCK.now_ns(), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0))
    await asyncio.sleep(1.0)
    with pytest.raises(AutopilotError, match="not finite"):
        autopilot.send_setpoint(Setpoint(_CLOCK.now_ns(), (0.0, math.nan, 1.0), (0.0, 0.0, 0.0), 0.0))
    await asyncio.sleep(0.1)
    assert px4.report().setpoints == 10


async def test_offboard_is_refused_without_a_stream(autopilot: MavsdkAutopilot, px4: Px4Process) -> None:
    await _fly(autopilot)
    began_s = time.monotonic()
    with pytest.raises(AutopilotError, match="mode is hold, its last answer was temporarily rejected"):
        await autopilot.request_offboard()
    assert time.monotonic() - began_s < 3.3
    px4.order("offboard silent")
    async with _streaming(autopilot, (0.0, 0.0, 0.0)):
        with pytest.raises(AutopilotError, match="its last answer was nothing"):
            await autopilot.request_offboard()
    assert px4.order("offboard accept").mode == "HOLD"
    await asyncio.sleep(1.0)
    assert px4.report().mode == "HOLD", "a request outlived its caller"


async def test_a_pilot_is_seen_and_given_way_to(autopilot: MavsdkAutopilot, px4: Px4Process) -> None:
    await _fly(autopilot)
    async with _streaming(autopilot, (0.0, 0.0, 0.0)):
        await autopilot.request_offboard()
        await asyncio.sleep(0.5)
        taken_ns = px4.order("pilot POSCTL").t_mono_ns
        while autopilot.state().mode is FlightMode.OFFBOARD:  # noqa: ASYNC110 - the port is polled
            await asyncio.sleep(0.002)
        noticed_s = (_CLOCK.now_ns() - taken_ns) / NS_PER_S
        print(f"the pilot's mode was noticed after {1000 * noticed_s:.0f} ms")
        assert autopilot.state().mode is FlightMode.MANUAL
        assert noticed_s < 0.2
        # A request that is under way when the pilot takes the mode is not repeated against the pilot.
        px4.order("offboard silent")
        request = asyncio.create_task(autopilot.request_offboard())
        await asyncio.sleep(0.1)
        px4.order("pilot ALTCTL")
        px4.order("pilot HOLD")
        with pytest.raises(AutopilotError, match="somebody else decided"):
            await request
    assert px4.report().mode == "HOLD"


async def test_velocity_alone_and_a_free_yaw(autopilot: MavsdkAutopilot, px4: Px4Process) -> None:
    await _fly(autopilot)
    yaw_rad = px4.report().yaw_enu_rad

    async def stream() -> None:
        async for now_ns in Ticker(_CLOCK, 20).ticks():
            autopilot.send_setpoint(Setpoint(now_ns, None, (0.0, 0.6, 0.0), None))

    streaming = asyncio.create_task(stream())
    try:
        await asyncio.sleep(0.3)
        await autopilot.request_offboard()
        await asyncio.sleep(2.0)
        report = px4.report()
        assert report.v_enu_m_s == pytest.approx((0.0, 0.6, 0.0), abs=0.05)
        assert report.yaw_enu_rad == pytest.approx(yaw_rad, abs=0.01)
    finally:
        streaming.cancel()
        await autopilot.return_home()
    assert px4.report().mode == "RTL"
