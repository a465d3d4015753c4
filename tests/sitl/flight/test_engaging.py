"""Engaging on the ground: what refuses it, who ends it, and an OFFBOARD that is not had."""

from __future__ import annotations

import asyncio
import os
import signal
import time

import pytest
import pytest_asyncio

from companion.errors import CompanionError
from companion.host.control_socket import ask
from tests.faults.figures import record
from tests.sitl.flying import Flying

pytestmark = pytest.mark.asyncio(loop_scope="package")


@pytest_asyncio.fixture(loop_scope="package", scope="module", autouse=True)
async def _on_the_ground(flying: Flying) -> None:
    await flying.stand()


async def test_an_engagement_is_refused_with_the_whole_list(flying: Flying) -> None:
    await flying.until(lambda status: not status["not_ready"])
    await flying.px4("parameter COM_OBL_RC_ACT 0")
    await flying.px4("parameter GF_ACTION 4")
    await flying.px4("estimator unhealthy")
    await flying.px4("battery 0.05")
    told = ("estimator is not healthy", "battery is low")
    await flying.until(lambda status: all(any(part in line for line in status["not_ready"]) for part in told), 10.0)
    answer = await flying.command("engage")
    assert not answer["ok"]
    for part in (
        "the battery is low: 5 %, wanted 20",
        "estimator is not healthy",
        "COM_OBL_RC_ACT is 0; wanted 4 (land) or 5 (hold): what PX4 does when the stream is lost",
        "GF_ACTION is 4; wanted 2 (hold), 3 (return) or 5 (land)",
    ):
        assert part in answer["error"]
    assert not (await flying.px4("parameter COM_OBL_RC_ACT 5")).armed
    for order in ("parameter GF_ACTION 2", "estimator healthy", "battery 0.9"):
        await flying.px4(order)


async def test_fault_61_who_gave_up_while_the_service_stood_still_engages_nobody(flying: Flying) -> None:
    at_rest = (await flying.until(lambda status: not status["not_ready"]))["state"]
    pid = flying.cast.pid("uav")
    os.kill(pid, signal.SIGSTOP)
    try:
        with pytest.raises(CompanionError, match="the service does not answer"):
            await ask(flying.stage.control_socket, "engage", timeout_s=1.0)
    finally:
        os.kill(pid, signal.SIGCONT)
    await flying.until(lambda status: not status["not_ready"])
    await asyncio.sleep(2.0)
    status, px4 = await flying.status(), await flying.px4()
    record(61, engaged=status["state"] != at_rest, armed=px4.armed)
    assert (status["state"], px4.armed, px4.landed) == (at_rest, False, True)


@pytest.mark.parametrize("how", ["command", "switch"])
async def test_an_abort_while_an_engagement_is_still_checked_ends_it(flying: Flying, how: str) -> None:
    at_rest = (await flying.until(lambda status: not status["not_ready"]))["state"]
    await flying.px4("rc 1500 1500 1900" if how == "switch" else "rc")
    await asyncio.sleep(0.3)
    await flying.px4("parameters silent")
    engaging = asyncio.create_task(flying.command("engage"))
    await asyncio.sleep(0.1)
    if how == "switch":
        await flying.px4("rc 1500 1500 1000")
    else:
        assert (await flying.command("abort"))["ok"]
    await asyncio.sleep(0.3)
    await flying.px4("parameters heard")  # they are asked for again
    answer = await engaging
    # On a loaded machine a line of the preflight may stand beside it.
    assert not answer["ok"] and "it was aborted meanwhile" in answer["error"].split("; ")
    await asyncio.sleep(0.2)
    report = await flying.px4("rc")
    assert not report.armed and (await flying.status())["state"] == at_rest


async def test_a_switch_that_is_up_when_rc_comes_back_engages_nothing(flying: Flying) -> None:
    at_rest = (await flying.until(lambda status: not status["not_ready"]))["state"]
    await flying.px4("rc 1500 1500 1000")
    await asyncio.sleep(0.5)
    await flying.px4("rc")  # no receiver any more
    await asyncio.sleep(1.3)
    await flying.px4("rc 1500 1500 1900")
    await asyncio.sleep(0.7)
    assert (await flying.status())["state"] == at_rest


async def test_hold_taken_by_a_person_during_the_climb_is_theirs(flying: Flying) -> None:
    before = await flying.px4("rc 1500 1500 1000")
    await asyncio.sleep(0.5)
    await flying.px4("rc 1500 1500 1900")  # engaged by the switch
    await flying.until(lambda _: flying.now.vehicle.p_enu_m[2] > 0.4, 20.0)
    await flying.px4("pilot HOLD")
    status = await flying.in_state("latched", timeout_s=10.0)
    assert "somebody else decided" in status["reason"]
    await asyncio.sleep(1.0)
    report = await flying.px4("rc")
    assert report.setpoints == before.setpoints and report.mode == "HOLD"


@pytest.mark.parametrize("how", ["refuse", "silent"])
async def test_fault_10_a_refused_or_ignored_offboard_is_given_up(flying: Flying, how: str) -> None:
    await flying.px4(f"offboard {how}")
    await flying.engage()
    await flying.until(lambda status: status["streaming"])
    since_s = time.monotonic()
    took_s = await flying.seconds_until_latched(since_s, 8.0) - 1.0  # the stream runs for 1 s before it is asked for
    status = await flying.status()
    record(10, given_up_after_s=round(took_s, 2))
    assert took_s < 3.2  # 3 s, and how often this test looks
    assert "offboard_refused: mode offboard: not confirmed by telemetry" in status["reason"]
    assert (await flying.px4("offboard accept")).mode == "HOLD"
