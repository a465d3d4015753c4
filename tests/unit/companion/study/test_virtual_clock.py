"""Virtual time: it jumps to the next sleeper, in order, and nobody wakes early."""

from __future__ import annotations

import asyncio

from companion.core.clock import NS_PER_S, Ticker
from companion.study.virtual_clock import VirtualClock


async def test_sleepers_wake_in_the_order_of_their_deadlines_at_exactly_these() -> None:
    clock, woken = VirtualClock(), []

    async def sleeper(name: str, *deadlines_ns: int) -> None:
        for deadline_ns in deadlines_ns:
            await clock.sleep_until_ns(deadline_ns)
            woken.append((name, clock.now_ns()))

    tasks = [asyncio.create_task(sleeper("a", 30, 70)), asyncio.create_task(sleeper("b", 20, 30, 50))]
    seen: list[int] = []

    def live(now_ns: int) -> bool:
        seen.append(now_ns)
        return True

    await clock.run(live)
    await asyncio.gather(*tasks)
    assert woken == [("b", 20), ("a", 30), ("b", 30), ("b", 50), ("a", 70)]
    assert seen == [20, 30, 50, 70]


async def test_it_ends_when_told_and_a_cancelled_sleeper_is_passed_over() -> None:
    clock = VirtualClock()
    ticker, ticks = Ticker(clock, 20.0), []

    async def tick() -> None:
        async for now_ns in ticker.ticks():
            ticks.append(now_ns)

    ticking = asyncio.create_task(tick())
    sleeping = asyncio.create_task(clock.sleep_until_ns(NS_PER_S // 2))
    await asyncio.sleep(0)
    sleeping.cancel()
    await clock.run(lambda now_ns: now_ns < NS_PER_S)
    assert len(ticks) == 19  # every 50 ms, the one at 1 s not any more
    assert ticker.overruns == 0
    ticking.cancel()
    await asyncio.gather(ticking, sleeping, return_exceptions=True)
