"""TAK's sender as a real process: events reach a listener on loopback; killed or stopped it costs nothing."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from companion.config.file import load_config
from companion.config.schema import Config, TakConfig
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.messages import GpsFix, VehicleState
from companion.core.streams import TICK, VEHICLE
from companion.errors import ConfigError
from companion.roles.tak import TAK, Tak
from tests.cot import Cot, read_cot
from tests.paths import CONFIGS
from tests.unit.companion.roles.test_page import Kept, children

_PATIENCE_S = 120.0
UAV = load_config(CONFIGS / "demo-uav.yaml")


def config(**tak: object) -> Config:
    return replace(UAV, tak=TakConfig(enabled=True, **tak))  # type: ignore[arg-type]


@asynccontextmanager
async def service(port: int) -> AsyncIterator[tuple[Kept, list[int]]]:
    """A loop that records as a service does, and tells TAK. The numbers are of ticks that were begun."""
    clock, kept, begun = EventClock(MonotonicClock()), Kept(), [0]
    tak = Tak(config(address="127.0.0.1", port=port, period_s=0.2, callsign="Rescue 7"), clock, kept)

    async def tick() -> None:
        while True:
            now_ns = clock.now_ns()
            begun[0] += 1
            gps = GpsFix(
                t_mono_ns=now_ns, latitude_deg=47.4, longitude_deg=8.5, hae_m=540.0, horizontal_m=0.8, vertical_m=None
            )
            tak.recorder.record(TICK, now_ns, None)
            state = VehicleState(t_mono_ns=now_ns, p_local_enu_m=(0.0, 0.0, 2.0), in_air=True, gps=gps)
            tak.recorder.record(VEHICLE, now_ns, state)
            await asyncio.sleep(0.02)

    tak.start(dict)
    ticking = asyncio.create_task(tick())
    try:
        yield kept, begun
    finally:
        ticking.cancel()
        await tak.aclose()


async def event(listener: socket.socket) -> Cot:
    async with asyncio.timeout(_PATIENCE_S):
        return read_cot(await asyncio.get_running_loop().sock_recv(listener, 65536))


async def test_fault_60_taks_sender_killed_or_stopped_costs_the_loop_nothing() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        listener.setblocking(False)
        async with service(listener.getsockname()[1]) as (kept, begun):
            got = await event(listener)
            assert got.of("contact") == {"callsign": "Rescue 7"}
            assert got.point == {"lat": 47.4, "lon": 8.5, "hae": 540.0, "ce": 0.8, "le": 9999999.0}
            (pid,) = children(TAK)
            os.kill(pid, signal.SIGSTOP)
            before = begun[0]
            while begun[0] < before + 150:  # noqa: ASYNC110 - it is polled
                await asyncio.sleep(0.05)
            os.kill(pid, signal.SIGKILL)
            await event(listener)  # what it sent before is read,
            async with asyncio.timeout(_PATIENCE_S):
                while children(TAK) in ([pid], []):  # noqa: ASYNC110 - and another begins
                    await asyncio.sleep(0.05)
            while True:
                try:
                    listener.recv(65536)
                except BlockingIOError:
                    break
            await event(listener)
            assert kept.ticks == begun[0]
    assert children(TAK) == []


async def test_off_it_is_nothing_at_all() -> None:
    kept = Kept()
    tak = Tak(UAV, EventClock(MonotonicClock()), kept)
    assert tak.recorder is kept
    tak.start(dict)
    await tak.aclose()
    assert children(TAK) == []


def test_a_key_that_others_can_read_and_a_file_that_is_missing_are_told(tmp_path: Path) -> None:
    files = {name: str(tmp_path / name) for name in ("ca_file", "cert_file", "key_file")}
    for name in ("ca_file", "cert_file"):
        (tmp_path / name).touch()
    clock = EventClock(MonotonicClock())
    with pytest.raises(ConfigError, match=r"tak\.key_file: .*No such file"):
        Tak(config(transport="tls", **files), clock, Kept())
    (tmp_path / "key_file").touch(mode=0o644)
    with pytest.raises(ConfigError, match=r"tak\.key_file: .*chmod 600"):
        Tak(config(transport="tls", **files), clock, Kept())
