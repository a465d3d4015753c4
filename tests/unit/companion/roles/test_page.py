"""The page of a service as real processes: killed, stopped and flooded, while the loop beside it goes on recording."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import urllib.request
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from companion.config.file import load_config
from companion.config.schema import PageConfig
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.messages import VehicleState
from companion.core.streams import TICK, VEHICLE, Stream
from companion.errors import ConfigError
from companion.roles.page import PAGE, Page
from tests.paths import CONFIGS

_PATIENCE_S = 120.0


class Kept:
    """A log that only counts."""

    failed = False

    def __init__(self) -> None:
        self.ticks = 0

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        self.ticks += stream is TICK

    def counters(self) -> dict[str, int]:
        return {}


def free_tcp_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert isinstance(port, int)
    return port


@asynccontextmanager
async def service(port: int) -> AsyncIterator[tuple[Kept, list[int]]]:
    """A loop that records as a service does, with its page. The numbers are of ticks that were begun."""
    config = replace(load_config(CONFIGS / "demo-uav.yaml"), page=PageConfig(enabled=True, port=port))
    clock, kept, begun = EventClock(MonotonicClock()), Kept(), [0]
    page = Page(config, clock, kept)

    async def tick() -> None:
        while True:
            now_ns = clock.now_ns()
            begun[0] += 1
            page.recorder.record(TICK, now_ns, None)
            page.recorder.record(VEHICLE, now_ns, VehicleState(t_mono_ns=now_ns, heartbeat_mono_ns=now_ns))
            await asyncio.sleep(0.02)

    page.start(lambda: {"state": "idle", "not_ready": [], "reason": ""})
    ticking = asyncio.create_task(tick())
    try:
        yield kept, begun
    finally:
        ticking.cancel()
        await page.aclose()


def children(module: str) -> list[int]:
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            command = (folder / "cmdline").read_bytes().split(b"\0")
            if int(fields[1]) == os.getpid() and module.encode() in command and b"companion.host.child" not in command:
                found.append(int(folder.name))
    return found


def look(port: int) -> dict[str, Any]:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/state", timeout=10) as answer:
        return json.loads(answer.read())["view"]  # type: ignore[no-any-return]


async def seen(port: int, is_so: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    view: dict[str, Any] = {}
    async with asyncio.timeout(_PATIENCE_S):
        while True:
            with suppress(OSError):
                view = await asyncio.to_thread(look, port)
                if is_so(view):
                    return view
            await asyncio.sleep(0.1)


async def test_fault_50_a_page_killed_stopped_and_flooded_costs_the_loop_nothing() -> None:
    port = free_tcp_port()
    async with service(port) as (kept, begun):
        await seen(port, lambda view: view["introduced"] and view["vehicle"] is not None)
        (pid,) = children(PAGE)
        os.kill(pid, signal.SIGSTOP)
        before = begun[0]
        while begun[0] < before + 150:  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.05)
        flood = [await asyncio.open_connection("127.0.0.1", port) for _ in range(40)]  # the kernel takes them
        for _, writer in flood:
            writer.write(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 50)
        os.kill(pid, signal.SIGCONT)
        first = await seen(port, lambda view: view["introduced"])
        await seen(port, lambda view: view["t_s"] > first["t_s"])
        for _, writer in flood:
            writer.close()
        os.kill(pid, signal.SIGKILL)
        await seen(port, lambda view: view["introduced"] and children(PAGE) != [pid])
        assert kept.ticks == begun[0]
    assert children(PAGE) == []


async def test_a_port_that_is_taken_ends_no_service(caplog: pytest.LogCaptureFixture) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        async with service(taken.getsockname()[1]) as (kept, begun), asyncio.timeout(_PATIENCE_S):
            while "the page's process ended with code 1" not in caplog.text:  # noqa: ASYNC110 - it is polled
                await asyncio.sleep(0.05)
            assert kept.ticks == begun[0] > 0


async def test_a_status_that_fails_ends_the_page_alone(caplog: pytest.LogCaptureFixture) -> None:
    config = replace(load_config(CONFIGS / "demo-uav.yaml"), page=PageConfig(enabled=True, port=free_tcp_port()))
    page = Page(config, EventClock(MonotonicClock()), Kept())

    def status() -> dict[str, Any]:
        raise RuntimeError("a mistake of ours")

    page.start(status)
    async with asyncio.timeout(_PATIENCE_S):
        while "the page has failed" not in caplog.text:  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.05)
    await page.aclose()
    assert children(PAGE) == []


async def test_without_a_page_nothing_stands_before_the_log() -> None:
    kept = Kept()
    page = Page(load_config(CONFIGS / "demo-uav.yaml"), EventClock(MonotonicClock()), kept)
    assert page.recorder is kept
    page.start(dict)
    await page.aclose()


def test_a_word_that_cannot_be_read_is_told_at_the_start(tmp_path: Path) -> None:
    config = replace(
        load_config(CONFIGS / "demo-uav.yaml"), page=PageConfig(enabled=True, token_file=str(tmp_path / "none"))
    )
    with pytest.raises(ConfigError, match="cannot read the token"):
        Page(config, EventClock(MonotonicClock()), Kept())
