"""The process around the edge: it ends silently, and killed it leaves the vehicle to its failsafe."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
import time

import pytest

from companion.core.clock import NS_PER_S
from tests.sitl.px4_process import Px4Process

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
