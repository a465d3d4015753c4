"""The live server as real processes: a viewer receives what the log holds, and nothing of it holds up the loop."""

from __future__ import annotations

import asyncio
import importlib.util
import os
import resource
import signal
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import aiohttp
import numpy as np
import pytest

from companion.config.file import load_config
from companion.config.schema import FoxgloveConfig
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.inputs import Tick
from companion.core.messages import Pose, Setpoint, VehicleState, pose_bytes
from companion.core.streams import CSI, POSE, POSE_IN, PROFILE, SETPOINT, TICK, TRANSFORMS, VEHICLE, Stream
from companion.errors import ConfigError
from companion.log.encoding import encoded, schema_of
from companion.roles.live import LIVE, LiveStreams
from tests.kept import Kept
from tests.live_viewer import viewing
from tests.paths import CONFIGS
from tests.unit.companion.roles.test_page import children, free_tcp_port

_PATIENCE_S = 120.0
_SECONDS = 6.0


def told(now_ns: int, number: int) -> list[tuple[Stream, Any]]:
    """What a flight records in 5 ms number `number`: packets, poses, and what the loop makes of them at 20 Hz."""
    place = (0.01 * number, 0.5, 1.5)
    pose = Pose(
        t_mono_ns=now_ns, p_enu_m=place, q_enu_from_body=(1.0, 0.0, 0.0, 0.0), v_enu_m_s=(0.1, 0.0, 0.0), confidence=3
    )
    messages: list[tuple[Stream, Any]] = [(CSI, bytes(231)), (POSE_IN, pose_bytes(pose))]
    if number % 4 == 0:
        messages.append((POSE, pose))
    if number % 10 == 0:
        vehicle = VehicleState(t_mono_ns=now_ns, heartbeat_mono_ns=now_ns, p_local_enu_m=place, yaw_enu_rad=0.3)
        messages += [
            (TICK, Tick(now_ns)),
            (VEHICLE, vehicle),
            (SETPOINT, Setpoint(now_ns, place, (0.1, 0.0, 0.0), 0.3)),
        ]
    if number % 100 == 0:
        messages.append((PROFILE, np.random.default_rng(number).random((180, 360)).astype(np.float16).tobytes()))
    return messages


@asynccontextmanager
async def service(**settings: Any) -> AsyncIterator[tuple[Kept, LiveStreams, list[float]]]:
    """A loop that records as a flight does; the list has the lateness of its turns [s]."""
    config = replace(load_config(CONFIGS / "demo-uav.yaml"), foxglove=FoxgloveConfig(enabled=True, **settings))
    clock, kept, late = EventClock(MonotonicClock()), Kept(), list[float]()
    live = LiveStreams(config, clock, kept)

    async def fly() -> None:
        begun_s, number = time.monotonic(), 0
        while True:
            now_ns = clock.now_ns()
            for stream, message in told(now_ns, number):
                live.recorder.record(stream, now_ns, message)
            number += 1
            due_s = begun_s + 0.005 * number
            late.append(time.monotonic() - due_s)
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))

    live.start()
    flying = asyncio.create_task(fly())
    try:
        yield kept, live, late
    finally:
        flying.cancel()
        await live.aclose()


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(_PATIENCE_S):
        while not is_so():  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.05)


ALL = {one.topic for one in (CSI, POSE_IN, POSE, TICK, VEHICLE, SETPOINT, PROFILE, TRANSFORMS)}


async def test_a_viewer_receives_what_the_log_holds_in_the_logs_own_schemas() -> None:
    port = free_tcp_port()
    async with service(port=port) as (kept, live, _), viewing(f"ws://127.0.0.1:{port}") as viewer:
        await until(lambda: set(viewer.channels) >= ALL)
        assert viewer.info["name"] == "uav"
        await viewer.subscribe((VEHICLE.topic, POSE.topic, TRANSFORMS.topic, CSI.topic))
        await until(lambda: len(viewer.messages.get(VEHICLE.topic, ())) > 20)
        feed = live.feed
        assert feed is not None
        offset_ns = feed._wall_minus_mono_ns
        for stream in (VEHICLE, POSE):
            logged = {
                encoded(stream, t_ns + offset_ns, message)[0] for one, t_ns, message in kept.messages if one is stream
            }
            assert {data for _, data in viewer.messages[stream.topic]} <= logged
            source = next(encoded(stream, t_ns, message)[1] for one, t_ns, message in kept.messages if one is stream)
            name, kind, text = schema_of(source)
            assert viewer.schema(stream.topic) == (name, kind, text)
        assert viewer.channels[TRANSFORMS.topic]["schemaName"] == "foxglove.FrameTransforms"
        assert {data for _, data in viewer.messages[CSI.topic]} == {bytes(231)}
        assert PROFILE.topic not in viewer.messages
        t_ns, _ = viewer.messages[VEHICLE.topic][-1]
        assert abs(t_ns - time.time_ns()) < 5e9
        assert viewer.info["capabilities"] == ["time"], "frames are looked up at the robot's time, not the viewer's"
        assert abs(viewer.times_ns[-1] - t_ns) < 1e9


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.long
async def test_what_it_costs_with_no_viewer_and_with_one() -> None:
    """Of the server's process, and of this one with the loop that records: with a viewer less without one."""
    port = free_tcp_port()
    async with service(port=port) as (_, live, _late):
        shares = {}
        feed = live.feed
        assert feed is not None

        async def measured(what: str) -> None:
            (pid,) = children(LIVE)
            before, own = _cpu_s(pid), resource.getrusage(resource.RUSAGE_SELF)
            sent, begun_s = feed.sent, time.monotonic()
            await asyncio.sleep(_SECONDS)
            seconds, after = time.monotonic() - begun_s, resource.getrusage(resource.RUSAGE_SELF)
            own_s = after.ru_utime + after.ru_stime - own.ru_utime - own.ru_stime
            shares[what] = (100 * (_cpu_s(pid) - before) / seconds, 100 * own_s / seconds, (feed.sent - sent) / seconds)

        async with viewing(f"ws://127.0.0.1:{port}") as viewer:
            await until(lambda: set(viewer.channels) >= ALL)
        await asyncio.sleep(1.0)
        await measured("none")
        # Its own process, as a viewer is: else its cost would be counted here.
        code = (
            "import asyncio, sys; from tests.live_viewer import viewing\n"
            "async def look():\n"
            f"    async with viewing('ws://127.0.0.1:{port}') as viewer:\n"
            f"        while len(viewer.channels) < {len(ALL)}: await asyncio.sleep(0.05)\n"
            "        await viewer.subscribe([t for t in viewer.channels if t not in ('/csi', '/pose/in')])\n"
            "        await asyncio.sleep(60)\n"
            "asyncio.run(look())"
        )
        process = await asyncio.create_subprocess_exec(sys.executable, "-c", code, cwd=CONFIGS.parent)
        try:
            await until(lambda: TRANSFORMS.topic in feed._subscribed)
            await asyncio.sleep(0.5)
            await measured("one")
        finally:
            process.kill()
            await process.wait()
    for what, (server, own, rate) in shares.items():
        print(f"{what} viewer: server {server:.1f} %, service and its load {own:.1f} %, {rate:.0f} messages/s")
    assert shares["none"][0] < 1.0 and shares["none"][2] < 1.0
    assert shares["one"][2] > 80


@pytest.mark.long
async def test_fault_55_a_live_server_killed_stopped_and_flooded_costs_the_loop_nothing() -> None:
    port = free_tcp_port()
    async with service(port=port) as (kept, live, late):
        async with viewing(f"ws://127.0.0.1:{port}") as viewer:
            await until(lambda: set(viewer.channels) >= ALL)
            await viewer.subscribe(ALL)
            await until(lambda: len(viewer.messages.get(CSI.topic, ())) > 20)
            (pid,) = children(LIVE)
            late.clear()
            os.kill(pid, signal.SIGSTOP)
            before = len(kept.messages)
            await asyncio.sleep(8.0)
            feed = live.feed
            assert feed is not None and feed.dropped > 0, "its socket is full, and nobody waits"
            flood = [await asyncio.open_connection("127.0.0.1", port) for _ in range(40)]
            for _, writer in flood:
                writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 50)
            os.kill(pid, signal.SIGCONT)
            await asyncio.sleep(1.0)
            for _, writer in flood:
                writer.close()
            assert len(kept.messages) - before > 2 * 150 * 9, "the log has gone on"
            os.kill(pid, signal.SIGKILL)
            await until(lambda: children(LIVE) not in ([], [pid]))
        async with viewing(f"ws://127.0.0.1:{port}") as again:
            await until(lambda: set(again.channels) >= ALL)
        late.sort()
        print(
            f"{len(late)} turns, half less than {1e3 * late[len(late) // 2]:.2f} ms late, most {1e3 * late[-1]:.0f} ms"
        )
        assert late[len(late) // 2] < 0.05


async def test_with_a_token_only_who_knows_it_looks(tmp_path: Path) -> None:
    port, word = free_tcp_port(), "a-word-of-sixteen-letters"
    (tmp_path / "token").write_text(word)
    (tmp_path / "token").chmod(0o600)
    async with (
        service(port=port, address="127.0.0.1", token_file=str(tmp_path / "token")),
        viewing(f"ws://127.0.0.1:{port}/?token={word}") as viewer,
    ):
        await until(lambda: set(viewer.channels) >= ALL)
        await viewer.subscribe((VEHICLE.topic,))
        await until(lambda: len(viewer.messages.get(VEHICLE.topic, ())) > 5)
        async with aiohttp.ClientSession() as session:
            for query in ("", "?token=another-word-of-letters"):
                with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                    await session.ws_connect(f"ws://127.0.0.1:{port}/{query}", protocols=["foxglove.sdk.v1"])
                assert refused.value.status == 401


async def test_off_nothing_stands_before_the_log_and_without_the_library_its_extra_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    config, clock, kept = load_config(CONFIGS / "demo-uav.yaml"), EventClock(MonotonicClock()), Kept()
    off = LiveStreams(config, clock, kept)
    off.start()
    assert off.recorder is kept and off.feed is None and children(LIVE) == []
    await off.aclose()
    on = replace(config, foxglove=FoxgloveConfig(enabled=True, token_file=str(tmp_path / "missing")))
    with pytest.raises(ConfigError, match="cannot read the token"):
        LiveStreams(on, clock, kept)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"pip install 'wsr-companion\[foxglove\]'"):
        LiveStreams(on, clock, kept)
