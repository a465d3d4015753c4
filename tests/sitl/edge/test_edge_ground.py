"""What a ground station at the vehicle's other link hears of us, whatever system the vehicle is."""

from __future__ import annotations

import asyncio
import math
import time
from pathlib import Path

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.core.clock import MonotonicClock
from tests.sitl.edge import OPTIONS
from tests.sitl.ground_link import ONBOARD_COMPUTER, GroundLink
from tests.sitl.px4_process import Px4Process


@pytest.mark.parametrize("configured", [None, 7])
async def test_sentences_values_and_a_heartbeat_of_the_vehicles_own_system(
    port: int, tmp_path: Path, configured: int | None
) -> None:
    refusal = "companion: engage refused: " + "; ".join(f"reason number {n}" for n in range(7))
    with GroundLink() as ground, Px4Process(port, tmp_path, *OPTIONS, "--system-id", "7", *ground.options):
        edge = MavsdkAutopilot(f"udpin://127.0.0.1:{port}", MonotonicClock(), None, configured, is_of_vehicle=True)
        await edge.connect()
        async with asyncio.timeout(10):
            while edge.state().clock_offset_ns is None:  # noqa: ASYNC110 - it is polled
                await asyncio.sleep(0.05)
        begun_s = time.perf_counter()
        edge.ground.say(4, refusal)
        edge.ground.show("wsr_range", 6.25)
        edge.ground.show("wsr_rng_sd", None)
        took_s = time.perf_counter() - begun_s
        await asyncio.to_thread(ground.wait, lambda: bool(ground.of("HEARTBEAT")) and len(ground.values()) == 2)
        await edge.aclose()
    heartbeat = ground.of("HEARTBEAT")[-1]
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (7, ONBOARD_COMPUTER)
    assert heartbeat.type == 18
    assert ground.sentences() == [refusal]
    assert ground.values()["wsr_range"] == 6.25 and math.isnan(ground.values()["wsr_rng_sd"])
    assert ground.of("NAMED_VALUE_FLOAT")[0].time_boot_ms > 9000, "the vehicle's own time"
    assert took_s < 0.05, "appended to a queue"
