"""Telling the ground beside a running loop: off it is nothing, a closed link and a mistake end nothing."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from companion.autopilot.ground_station import GroundStation
from companion.autopilot.port import AutopilotError
from companion.config.file import load_config
from companion.config.schema import Config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.inputs import Event, Wish
from companion.core.streams import WISH
from companion.roles import ground
from companion.roles.ground import Ground
from tests.kept import Kept
from tests.paths import CONFIGS


class Sent:
    def __init__(self) -> None:
        self.names: list[str] = []
        self.is_closed = False

    def send(self, name: str, /, **fields: Any) -> None:
        if self.is_closed:
            raise AutopilotError("not connected")
        self.names.append(name)


def configured(ground_hz: float) -> Config:
    config = load_config(CONFIGS / "demo-uav.yaml")
    assert config.autopilot is not None
    return replace(config, autopilot=replace(config.autopilot, ground_hz=ground_hz))


def status() -> dict[str, Any]:
    return {"state": "idle", "bearing": None, "bearing_stale": True, "target": None}


async def test_off_nothing_stands_before_the_log_and_no_task_runs() -> None:
    kept = Kept()
    off = Ground(configured(0.0), EventClock(MonotonicClock()), kept)
    before = asyncio.all_tasks()
    off.start(status, GroundStation(Sent(), lambda: 0))
    assert off.recorder is kept and not off.is_on and asyncio.all_tasks() == before
    await off.aclose()


async def test_a_link_that_is_closed_is_waited_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ground, "_LOOK_S", 0.01)
    sent = Sent()
    on = Ground(configured(4.0), EventClock(MonotonicClock()), Kept())
    on.start(status, GroundStation(sent, lambda: 0))
    sent.is_closed = True
    on.recorder.record(WISH, 0, Wish(t_mono_ns=0, wish=Event.ENGAGE, refusal="lost with the link"))
    await asyncio.sleep(0.1)
    sent.is_closed = False
    on.recorder.record(WISH, 0, Wish(t_mono_ns=0, wish=Event.ENGAGE, refusal="said"))
    async with asyncio.timeout(10):
        while len(set(sent.names)) < 2:  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.01)
    assert set(sent.names) == {"STATUSTEXT", "NAMED_VALUE_FLOAT"}
    await on.aclose()


async def test_a_mistake_of_its_own_ends_nothing_else(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(ground, "_LOOK_S", 0.01)
    on = Ground(configured(4.0), EventClock(MonotonicClock()), Kept())
    on.start(dict, GroundStation(Sent(), lambda: 0))
    await asyncio.sleep(0.1)
    assert "the service goes on without it" in caplog.text
    await on.aclose()
