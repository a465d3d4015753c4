"""The missions' event loop against asyncio's own at the same virtual time: the same calls at the same times."""

from __future__ import annotations

import asyncio
import contextlib
import math
import random
import selectors
from collections.abc import Callable

import pytest

from companion.core.clock import NS_PER_S
from tests.faults.missions.timeless import MissionClock, MissionLoop

_TASKS, _ENDS_S = 12, 20.0
_MOST = 60
"""Tasks in all. More than a hundred timers asyncio sorts anew while most are cancelled; who shares a time then changes
places."""
_Said = list[tuple[int, int, str]]


class _Selector(selectors.SelectSelector):
    """Waits for nothing but time."""

    def __init__(self, advance: Callable[[int], None], clock: MissionClock) -> None:
        super().__init__()
        self._advance, self._clock = advance, clock

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        assert timeout is not None
        if timeout > 0:
            self._advance(self._clock.t_ns + max(1, math.ceil(timeout * NS_PER_S)))
        return []


class _Asyncios(asyncio.SelectorEventLoop):
    """asyncio's own loop on that time."""

    def __init__(self, advance: Callable[[int], None], clock: MissionClock) -> None:
        self._clock = clock
        super().__init__(_Selector(advance, clock))

    def time(self) -> float:
        return self._clock.t_ns / NS_PER_S


async def _lives(seed: int, clock: MissionClock, said: _Said) -> None:
    """Tasks that sleep to shared beats, wait for each other, time out, start and cancel others."""
    rng = random.Random(seed)
    tasks: list[asyncio.Task[None]] = []
    bell = asyncio.Event()

    async def one(number: int) -> None:
        while clock.t_ns < _ENDS_S * NS_PER_S:
            what = rng.choice(("beat", "beat", "beat", "sleep", "yield", "bell", "ring", "cancel", "begin"))
            said.append((clock.t_ns, number, what))
            match what:
                case "beat":
                    period_ns = NS_PER_S // rng.choice((20, 10, 5))
                    await clock.sleep_until_ns((clock.t_ns // period_ns + 1) * period_ns)
                case "sleep":
                    await asyncio.sleep(rng.choice((0.05, 0.1, 1 / 3)))
                case "yield":
                    await asyncio.sleep(0)
                    clock.t_ns += 1000  # or who only yields stays for ever
                case "bell":
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(0.2):
                            await bell.wait()
                    bell.clear()
                case "ring":
                    bell.set()
                    await asyncio.sleep(0.01)
                case "cancel":
                    rng.choice(tasks).cancel()
                    await asyncio.sleep(0.05)
                case "begin":
                    if len(tasks) < _MOST:
                        tasks.append(asyncio.create_task(one(len(tasks))))
                    await asyncio.sleep(0.05)

    tasks += [asyncio.create_task(one(number)) for number in range(_TASKS)]
    while not all(task.done() for task in tasks):
        await asyncio.gather(*tasks, return_exceptions=True)


@pytest.mark.parametrize("seed", range(5))
def test_calls_come_in_the_order_and_at_the_times_of_asyncios_own_loop(seed: int) -> None:
    ours: _Said = []
    theirs: _Said = []
    clock = MissionClock()
    loop = MissionLoop(clock)
    loop.connect(lambda to_ns: setattr(clock, "t_ns", to_ns))
    loop.run_until_complete(_lives(seed, clock, ours))
    clock = MissionClock()
    asyncios = _Asyncios(lambda to_ns: setattr(clock, "t_ns", to_ns), clock)
    try:
        asyncios.run_until_complete(_lives(seed, clock, theirs))
    finally:
        asyncios.close()
    assert len(ours) > 1000
    assert ours == theirs


def test_a_mission_that_waits_for_nothing_says_so() -> None:
    async def waits() -> None:
        await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="never comes"):
        MissionLoop(MissionClock()).run_until_complete(waits())
