"""What a ground station at the vehicle's other link is told of a flight; a flood of refusals delays nothing."""

from __future__ import annotations

import asyncio
import math
import time

import pytest

from companion.flight.announcements import BURST, PER_S
from tests.sitl.flying import IN_OFFBOARD, Flying
from tests.sitl.ground_link import ONBOARD_COMPUTER

pytestmark = pytest.mark.asyncio(loop_scope="package")
_FLOOD_S = 5.0


@pytest.mark.long
async def test_fault_51_the_ground_sees_who_flies_and_a_flood_of_refusals_costs_the_flight_nothing(
    flying: Flying,
) -> None:
    ground, since_s = flying.ground, time.monotonic()
    assert ground is not None
    await flying.stand()
    await flying.fly()
    await flying.px4("forget gaps")

    def is_shown() -> bool:
        known = {one.name for one in ground.of("NAMED_VALUE_FLOAT", since_s) if one.value > 0}
        is_flying = any("acquiring (offboard_confirmed)" in text for text in ground.sentences(since_s))
        return is_flying and {"wsr_state", "wsr_brg", "wsr_rel", "wsr_range"} <= known

    await asyncio.to_thread(ground.wait, is_shown)
    said = ground.sentences(since_s)
    for words in ("companion: preflight (engage)", "companion flies: acquiring (offboard_confirmed)"):
        assert words in said, said
    shown = ground.of("NAMED_VALUE_FLOAT", since_s)
    assert all(0 <= one.value < 360 for one in shown if one.name == "wsr_brg" and not math.isnan(one.value))
    assert all(0 <= one.value <= 1 for one in shown if one.name == "wsr_rel" and not math.isnan(one.value))
    heartbeats = ground.of("HEARTBEAT", since_s)
    assert {(one.get_srcSystem(), one.get_srcComponent(), one.type) for one in heartbeats} == {
        (1, ONBOARD_COMPUTER, 18)
    }
    first, began_s, refused = await flying.px4(), time.monotonic(), 0
    while time.monotonic() < began_s + _FLOOD_S:
        refused += not (await flying.command("engage"))["ok"]
    last = await flying.px4()
    seconds = time.monotonic() - began_s
    assert refused > 100, "each of them an answer to a person"
    assert len(ground.of("STATUSTEXT", began_s)) <= BURST + PER_S * seconds + 1
    assert last.setpoints - first.setpoints > 18 * seconds and last.largest_gap_s < 0.5
    assert (await flying.status())["state"] in IN_OFFBOARD
    print(
        f"{refused} refusals in {seconds:.1f} s, largest gap {last.largest_gap_s:.3f} s, said {said}, {ground.values()}"
    )
