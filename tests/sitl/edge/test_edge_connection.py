"""Which vehicle the edge speaks to: one that restarts is found again, any other is left alone or refused."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S, MonotonicClock
from companion.core.messages import Setpoint
from tests.sitl.edge import OPTIONS
from tests.sitl.px4_process import Px4Process

_CLOCK = MonotonicClock()


async def test_a_restarted_autopilot_is_found_again_and_asked_again(port: int, tmp_path: Path) -> None:
    edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", _CLOCK)
    running = asyncio.create_task(edge.run())
    try:
        for life in range(2):
            with Px4Process(port, tmp_path, *OPTIONS) as px4:
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
