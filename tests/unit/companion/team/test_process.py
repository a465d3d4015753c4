"""The team's process as a real one: it answers, and killed, stopped or flooded it costs the loop beside it nothing."""

from __future__ import annotations

import asyncio
import os
import signal
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import pytest

from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.core.streams import TEAM, Stream
from companion.team.news import News
from companion.team.process import WORKER, TeamProcess
from companion.team.records import TeamState
from tests.unit.companion.roles.test_page import children
from tests.unit.companion.team.test_estimate import SEEN

_PATIENCE_S = 120.0


class Kept:
    """A log of the team alone."""

    failed = False

    def __init__(self) -> None:
        self.states: list[TeamState] = []

    def record(self, stream: Stream, t_mono_ns: int, message: Any) -> None:
        assert stream is TEAM and t_mono_ns == message.t_mono_ns
        self.states.append(message)

    def counters(self) -> dict[str, int]:
        return {}


class Beside:
    """A loop of 50 Hz, and the longest it waited for a turn."""

    def __init__(self) -> None:
        self.ticks = 0
        self.worst_s = 0.0

    async def run(self) -> None:
        while True:
            due_s = time.monotonic() + 0.02
            await asyncio.sleep(0.02)
            self.worst_s = max(self.worst_s, time.monotonic() - due_s)
            self.ticks += 1


@asynccontextmanager
async def running(news: Callable[[int], News]) -> AsyncIterator[tuple[TeamProcess, Kept, Beside]]:
    kept, beside = Kept(), Beside()
    team = TeamProcess(
        own=1, names={2: "two", 3: "three"}, clock=EventClock(MonotonicClock()), recorder=kept, news=news
    )
    team.start()
    ticking = asyncio.create_task(beside.run())
    try:
        yield team, kept, beside
    finally:
        ticking.cancel()
        await team.aclose()
    assert children(WORKER) == []


async def until(is_so: Callable[[], bool]) -> None:
    async with asyncio.timeout(_PATIENCE_S):
        while not is_so():  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.05)


def news(now_ns: int) -> News:
    places = [(robot, 1, now_ns, (float(robot), 0.0, 0.0)) for robot in (1, 2, 3)]
    return News(now_ns, places, [SEEN._replace(t_ns=now_ns, number=now_ns // 10**9 & 0xFFFF)])


async def test_it_answers_each_second_and_the_status_has_every_robot() -> None:
    async with running(news) as (team, kept, _):
        assert team.status()["robots"] == {} and team.status()["age_s"] is None
        await until(lambda: bool(kept.states and kept.states[-1].sightings and team.status()["robots"]))
        status = team.status()
        assert list(status["robots"]) == ["two", "three"]
        assert status["robots"]["two"]["sightings"] > 0 == status["robots"]["three"]["sightings"]
        assert not status["robots"]["two"]["placed"]
        assert 0.0 < status["own_axes_std_deg"] < 8.0
        assert kept.states[-1].solve_s > 0.0


async def test_fault_59_the_teams_process_killed_stopped_and_flooded_costs_the_loop_nothing() -> None:
    flood = [False]

    def told(now_ns: int) -> News:
        one = news(now_ns)
        if not flood[0]:
            return one
        return News(now_ns, one.places, [SEEN._replace(number=n, t_ns=now_ns) for n in range(2000)])

    async with running(told) as (team, kept, beside):
        await until(lambda: bool(kept.states))
        (pid,) = children(WORKER)
        os.kill(pid, signal.SIGSTOP)
        flood[0] = True
        before = beside.ticks
        await until(lambda: team.dropped >= 2)
        assert beside.ticks > before
        assert team._process is not None and team._process.stdin is not None
        assert team._process.stdin.transport.get_write_buffer_size() < 2_000_000  # it does not grow
        flood[0] = False
        os.kill(pid, signal.SIGKILL)
        answered = len(kept.states)
        await until(lambda: len(kept.states) > answered and children(WORKER) != [pid])
        assert team.restarts == 1


async def test_what_cannot_be_told_ends_the_team_alone(caplog: pytest.LogCaptureFixture) -> None:
    def broken(now_ns: int) -> News:
        raise RuntimeError("a mistake of ours")

    async with running(broken):
        await until(lambda: "the team has failed" in caplog.text)
