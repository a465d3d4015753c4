"""What the edge hears and is asked: how old it is, parameters, and what both ends tell each other."""

from __future__ import annotations

import asyncio
import time

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S, MonotonicClock
from companion.core.messages import Pose
from tests.sitl.px4_process import Px4Process

_CLOCK = MonotonicClock()


async def test_silence_of_the_autopilot_shows_in_the_age_of_its_heartbeat(
    autopilot: MavsdkAutopilot, px4: Px4Process
) -> None:
    px4.order("mute everything")
    await asyncio.sleep(1.5)
    state = autopilot.state()
    assert state.heartbeat_mono_ns is not None and state.position_mono_ns is not None
    assert state.t_mono_ns - state.heartbeat_mono_ns > 1.4 * NS_PER_S
    assert state.t_mono_ns - state.position_mono_ns > 1.4 * NS_PER_S
    px4.order("mute nothing")
    await asyncio.sleep(1.2)
    time.sleep(1.0)  # noqa: ASYNC251 - a stalled event loop must not make telemetry look old, nor fresh
    state = autopilot.state()
    assert state.position_mono_ns is not None
    assert state.t_mono_ns - state.position_mono_ns < 0.1 * NS_PER_S


async def test_parameters(autopilot: MavsdkAutopilot, px4: Px4Process) -> None:
    assert await autopilot.parameter("COM_OBL_RC_ACT") == 5
    assert await autopilot.parameter("COM_OF_LOSS_T") == pytest.approx(1.0)
    with pytest.raises(AutopilotError, match="NO_SUCH"):
        await autopilot.parameter("NO_SUCH")


async def test_what_both_ends_tell_each_other(px4: Px4Process, port: int) -> None:
    odometry: list[Pose] = []
    edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK, odometry.append)
    running = asyncio.create_task(edge.run())
    try:
        async with asyncio.timeout(10):
            while edge.problem or None in (edge.state().estimator_mono_ns, edge.state().clock_offset_ns):  # noqa: ASYNC110 - the port is polled
                await asyncio.sleep(0.02)
        px4.order("say Preflight Fail: compass")
        px4.order("rc 1500 1500 1900")
        px4.order("estimator unhealthy")
        for value in (4, 1.25):
            name = "COM_OBL_RC_ACT" if value == 4 else "COM_OF_LOSS_T"
            await edge.set_parameter(name, value)
            assert await edge.parameter(name) == value == px4.report().parameters[name]
        for count in range(40):
            edge.send_odometry(
                Pose(
                    t_mono_ns=_CLOCK.now_ns(),
                    p_enu_m=(1.0, 2.0, 3.0),
                    q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
                    v_enu_m_s=(0.0, 0.0, 0.0),
                    confidence=3,
                ),
                count,
            )
            await asyncio.sleep(0.025)
        state, report, events = edge.state(), px4.report(), edge.take_events()
        assert report.vision == 40 and report.onboard_statuses >= 1
        # Beside it, where the machine is slow, the vehicle's own events about its checks.
        said = [event for event in events if not event.text.startswith("event ")]
        assert [(event.severity, event.text) for event in said] == [(4, "Preflight Fail: compass")]
        assert not [event for event in edge.take_events() if event in said]
        assert state.rc_us == (1500, 1500, 1900) and not state.estimator_healthy
        assert state.timesync_mono_ns is not None and len(odometry) > 20
        assert odometry[-1].p_enu_m == pytest.approx(report.p_enu_m, abs=0.1)
        assert report.vision_age_s is not None and abs(report.vision_age_s) < 0.5, "poses carry the vehicle's time"
        assert state.clock_offset_ns is not None
        assert (_CLOCK.now_ns() + state.clock_offset_ns) / NS_PER_S == pytest.approx(px4.report().clock_s, abs=0.2)
    finally:
        running.cancel()
        await edge.aclose()


async def test_its_arming_checks_and_their_reasons_come_through_the_library(
    autopilot: MavsdkAutopilot, px4: Px4Process
) -> None:
    async def told(can_arm: bool, reasons: tuple[str, ...]) -> None:
        async with asyncio.timeout(20):
            while (autopilot.state().can_arm, autopilot.state().arming_reasons) != (can_arm, reasons):  # noqa: ASYNC110
                await asyncio.sleep(0.02)

    await told(True, ())
    px4.order("checks fail high_accel_bias")
    await told(False, ("estimator high accel bias",))
    px4.order("checks pass")
    await told(True, ())
