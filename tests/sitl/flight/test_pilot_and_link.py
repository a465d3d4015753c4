"""The vehicle in somebody else's hands, out of hearing, or low on energy: it is left alone, or landed."""

from __future__ import annotations

import asyncio
import time

import pytest

from companion.core.clock import NS_PER_S
from tests.faults.campaigns import runs
from tests.faults.figures import record
from tests.sitl.flying import Flying

pytestmark = pytest.mark.asyncio(loop_scope="package")


@pytest.mark.parametrize("part", range(runs(1, 5)))
async def test_fault_09_a_pilot_is_obeyed_and_never_overruled(flying: Flying, part: int) -> None:
    last_s, taken_back = 0.0, 0
    count = runs(2, 20)
    for number in range(count):
        await flying.fly()
        await asyncio.sleep(0.2)
        taken = await flying.px4(f"pilot {('POSCTL', 'ALTCTL', 'HOLD')[number % 3]}")
        await flying.in_state("latched", timeout_s=2.0)
        await asyncio.sleep(0.5)
        if number == 0:
            assert (await flying.command("abort"))["ok"]
            await asyncio.sleep(1.0)
            refusal = (await flying.command("engage"))["error"]
            assert "the vehicle is flown in mode manual; put it into hold first" in refusal
        after = await flying.px4()
        assert after.last_setpoint_mono_ns is not None
        last_s = max(last_s, (after.last_setpoint_mono_ns - taken.t_mono_ns) / NS_PER_S)
        taken_back += after.mode != taken.mode
    record(9, runs=count, last_set_point_after_s=round(last_s, 3), taken_back=taken_back)
    assert last_s <= 0.2 and taken_back == 0


async def test_fault_08_silent_heartbeats_lose_the_link(flying: Flying) -> None:
    figures: dict[str, float] = {}
    for what in ("everything", "heartbeats"):
        await flying.fly()
        await flying.px4(f"mute {what}")
        since_s = time.monotonic()
        took_s = await flying.seconds_until_latched(since_s, 5.0)
        status = await flying.status()
        sent = await flying.px4("mute nothing")
        figures[f"{what}_lost_after_s"] = round(took_s, 2)
        # Without telemetry there is no place to hold at: the gate lets nothing out, and that ends the stream sooner.
        assert status["reason"] == "link_lost" or (what, status["reason"]) == ("everything", "stalled")
        # The bar is 1.5 s after the newest heartbeat; one may have come just before the silence began.
        assert took_s <= 1.5 + 0.2
        await asyncio.sleep(1.5)
        report = await flying.px4()
        assert report.setpoints == sent.setpoints and report.mode == "HOLD"
        assert (await flying.status())["state"] == "latched", "only a person engages again"
    record(8, **figures)


async def test_a_low_battery_lands_the_vehicle(flying: Flying) -> None:
    await flying.fly()
    await flying.px4("battery 0.1")
    status = await flying.in_state("landing", timeout_s=3.0)
    await flying.until(lambda _: flying.now.vehicle.mode == "LAND", 5.0)
    await flying.px4("battery 0.9")
    assert status["reason"] == "battery_low" and not status["streaming"]
    await flying.let_go()
