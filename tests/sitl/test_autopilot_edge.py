"""The MAVSDK edge against the mock autopilot in a process of its own, over real UDP.

Nothing here depends on the mock's timing beyond what PX4 itself promises.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import signal
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S, MonotonicClock, Ticker
from companion.core.messages import FlightMode, Pose, Setpoint
from companion.sim.px4.process import Px4Process

_CLOCK = MonotonicClock()
_OPTIONS = ("--param", "COM_DISARM_LAND=0.5", "--param", "COM_OBL_RC_ACT=5")


@pytest.fixture
def port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def px4(port: int, tmp_path: Path) -> Iterator[Px4Process]:
    with Px4Process(port, tmp_path, *_OPTIONS) as process:
        yield process


@pytest.fixture
async def autopilot(px4: Px4Process, port: int) -> AsyncIterator[MavsdkAutopilot]:
    edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK)
    await edge.connect()
    yield edge
    await edge.aclose()


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
        assert truth.largest_gap_s < 0.15
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
    assert landed.landed and landed.mode == "HOLD" and landed.largest_gap_s < 0.15
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
            edge.send_odometry(Pose(_CLOCK.now_ns(), (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 3), count)
            await asyncio.sleep(0.025)
        state, report, events = edge.state(), px4.report(), edge.take_events()
        assert report.vision == 40 and report.onboard_statuses >= 1
        assert [(event.severity, event.text) for event in events] == [(4, "Preflight Fail: compass")]
        assert edge.take_events() == []
        assert state.rc_us == (1500, 1500, 1900) and not state.estimator_healthy
        assert state.timesync_mono_ns is not None and len(odometry) > 20
        assert odometry[-1].p_enu_m == pytest.approx(report.p_enu_m, abs=0.1)
        assert report.vision_age_s is not None and abs(report.vision_age_s) < 0.5, "poses carry the vehicle's time"
        assert state.clock_offset_ns is not None
        assert (_CLOCK.now_ns() + state.clock_offset_ns) / NS_PER_S == pytest.approx(px4.report().clock_s, abs=0.2)
    finally:
        running.cancel()
        await edge.aclose()


async def test_a_restarted_autopilot_is_found_again_and_asked_again(port: int, tmp_path: Path) -> None:
    edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK)
    running = asyncio.create_task(edge.run())
    try:
        for life in range(2):
            with Px4Process(port, tmp_path, *_OPTIONS) as px4:
                async with asyncio.timeout(25):
                    while edge.problem:  # noqa: ASYNC110 - the port is polled
                        await asyncio.sleep(0.02)
                begin = px4.report().timesync_answers
                async with asyncio.timeout(10):
                    while (  # noqa: ASYNC110 - the port is polled
                        _CLOCK.now_ns() - (edge.state().position_mono_ns or 0) > 0.2 * NS_PER_S
                        or px4.report().timesync_answers <= begin
                    ):
                        await asyncio.sleep(0.02)
            if life == 0:
                async with asyncio.timeout(10):
                    while not edge.problem:  # noqa: ASYNC110 - the port is polled
                        await asyncio.sleep(0.02)
                assert "its heartbeats stopped" in edge.problem or "no heartbeat" in edge.problem
    finally:
        running.cancel()
        await edge.aclose()


async def test_another_vehicle_on_the_link_is_never_taken_for_ours(
    px4: Px4Process, port: int, caplog: pytest.LogCaptureFixture
) -> None:
    edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK)
    running = asyncio.create_task(edge.run())
    try:
        async with asyncio.timeout(10):
            while edge.problem:  # noqa: ASYNC110 - the port is polled
                await asyncio.sleep(0.02)
        px4.order("stranger 2")
        async with asyncio.timeout(5):
            while "system 2 (PX4) is on the link too and is left alone" not in caplog.text:  # noqa: ASYNC110
                await asyncio.sleep(0.02)
        px4.order("vanish")
        async with asyncio.timeout(20):
            while "left alone" not in edge.problem:  # noqa: ASYNC110 - the port is polled
                await asyncio.sleep(0.02)
        assert "no heartbeat of system 1" in edge.problem and "system 2 (PX4)" in edge.problem
        state = edge.state()
        assert state.system_id == 1 and state.t_mono_ns - (state.heartbeat_mono_ns or 0) > 5 * NS_PER_S
        received = px4.report().strangers[0].received
        assert set(received) <= {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG 512", "ONBOARD_COMPUTER_STATUS", "PING"}, (
            "the library asks every system for its version, by itself"
        )
    finally:
        running.cancel()
        await edge.aclose()


async def test_a_vehicle_that_reboots_within_five_seconds_is_asked_again(px4: Px4Process, port: int) -> None:
    edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK, system_id=1)
    running = asyncio.create_task(edge.run())
    try:
        async with asyncio.timeout(10):
            while edge.problem or not edge.state().firmware:  # noqa: ASYNC110 - the port is polled
                await asyncio.sleep(0.02)
        asked = px4.order("reboot 3").received["COMMAND_LONG 511"]
        async with asyncio.timeout(10):
            while not edge.state().boots:  # noqa: ASYNC110 - the port is polled
                await asyncio.sleep(0.02)
        await asyncio.sleep(1.0)
        assert px4.report().received["COMMAND_LONG 511"] == 2 * asked and edge.state().firmware == "1.16.1"
        assert any("restarted" in event.text for event in edge.take_events())
    finally:
        running.cancel()
        await edge.aclose()


@pytest.mark.parametrize(
    ("options", "system_id", "said"),
    [
        (("--kind", "ardupilot"), None, r"system 1 \(ArduPilot\) is no PX4 and is left alone"),
        (("--kind", "ardupilot"), 1, r"system 1 \(ArduPilot\) is no PX4 and is left alone"),
        (("--system-id", "2"), 1, r"no heartbeat of system 1 within 2 s; heard and left alone: system 2 \(PX4\)"),
    ],
)
async def test_what_is_not_our_px4_is_refused_in_one_line(
    port: int, tmp_path: Path, options: tuple[str, ...], system_id: int | None, said: str
) -> None:
    with Px4Process(port, tmp_path, *options) as px4:
        edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK, system_id=system_id)
        with pytest.raises(AutopilotError, match=said):
            await edge.connect(timeout_s=2.0)
        # The library asks every system for its version, by itself.
        assert set(px4.report().received) <= {"HEARTBEAT", "COMMAND_LONG 512", "PING"}


async def test_bad_connections_are_one_clear_error(port: int) -> None:
    nobody = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK)
    with pytest.raises(AutopilotError, match="no heartbeat"):
        await nobody.connect(timeout_s=0.5)
    with pytest.raises(AutopilotError, match="not connected"):
        nobody.send_setpoint(Setpoint(0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0))
    with pytest.raises(AutopilotError, match="expected udpin"):
        await MavsdkAutopilot("nonsense", _CLOCK).connect()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", port))
        with pytest.raises(AutopilotError, match="taken by another process"):
            await nobody.connect()


_CLIENT = textwrap.dedent(
    """
    import asyncio, sys
    from companion.autopilot.mavsdk_edge import MavsdkAutopilot
    from companion.core.clock import MonotonicClock, Ticker
    from companion.core.messages import Setpoint

    async def main(url, task):
        clock = MonotonicClock()
        autopilot = MavsdkAutopilot(url, clock)
        await autopilot.connect()
        if task == "close":
            await autopilot.aclose()
            await autopilot.aclose()
        if task != "stream":
            return
        await autopilot.arm()
        await autopilot.takeoff(1.5)
        request = None
        async for now_ns in Ticker(clock, 20).ticks():
            autopilot.send_setpoint(Setpoint(now_ns, (0.0, 0.0, 1.5), (0.0, 0.0, 0.0), 0.0))
            request = request or asyncio.create_task(autopilot.request_offboard())

    asyncio.run(main(*sys.argv[1:]))
    """
)


def _client(port: int, task: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", _CLIENT, f"udpin://127.0.0.1:{port}", task]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.mark.parametrize("task", ["close", "leave"])
def test_process_exits_cleanly_and_silently(px4: Px4Process, port: int, task: str) -> None:
    """Closed or not: no native crash at exit, and none of the library's log lines on standard output."""
    with _client(port, task) as client:
        output, _ = client.communicate(timeout=20)
        assert (client.returncode, output) == (0, "")


def test_kill_of_a_streaming_process_ends_the_stream_and_leaves_px4_to_its_failsafe(px4: Px4Process, port: int) -> None:
    with _client(port, "stream") as client:
        px4.wait_until(lambda report: report.setpoints_in_offboard > 20, 20)
        client.send_signal(signal.SIGKILL)
        killed_ns = time.monotonic_ns()
        client.communicate()
    report = px4.wait_until(lambda report: report.failsafe, 3)
    assert report.last_setpoint_mono_ns is not None
    late_s = (report.last_setpoint_mono_ns - killed_ns) / NS_PER_S
    print(f"last set point {1000 * late_s:.0f} ms after the kill; failsafe {report.mode}")
    assert late_s < 0.2
    assert report.mode == "HOLD" and (report.t_mono_ns - report.last_setpoint_mono_ns) / NS_PER_S >= 1.0
    time.sleep(0.5)
    assert px4.report().setpoints == report.setpoints
