"""A vehicle that demands signing, flown through the relay: refused with another key, latched without the relay."""

from __future__ import annotations

import asyncio
import os
import secrets
import signal
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import pytest_asyncio

from companion.signing.autopilot import RELAY
from tests.signed_link import key_file
from tests.sitl.flying import IN_OFFBOARD, Flying
from tests.sitl.flying import flying as running

pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest_asyncio.fixture(loop_scope="module", scope="module")
async def flying(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Flying]:
    folder = tmp_path_factory.mktemp("signed")
    key_file(folder / "vehicle.key")
    key_file(folder / "ours.key", secrets.token_bytes(32))
    demands = ("--signing-key", str(folder / "vehicle.key"))
    autopilot = {"signing_key_file": str(folder / "ours.key")}
    async with running(folder, autopilot=autopilot, px4_options=demands) as started:
        yield started


async def test_another_key_is_refused_in_words_and_the_right_one_is_not(flying: Flying) -> None:
    status = await flying.until(lambda one: any("carry a signature that" in text for text in one["not_ready"]))
    (words,) = [text for text in status["not_ready"] if "signature" in text]
    print(words)
    assert "ours.key does not make: the vehicle has another key" in words and "no heartbeat of the autopilot" in words
    answer = await flying.command("engage")
    assert not answer["ok"] and "the vehicle has another key" in answer["error"]
    assert (await flying.px4()).setpoints == 0
    await _take_the_vehicles_key(flying)


@pytest.mark.long
async def test_fault_54_a_relay_killed_or_stopped_in_flight_ends_the_stream_and_we_latch(flying: Flying) -> None:
    await _take_the_vehicles_key(flying)
    for number in (signal.SIGKILL, signal.SIGSTOP):
        await flying.fly()
        before = await flying.px4()
        assert before.mode == "OFFBOARD"
        pid = _relay(flying)
        cpu_s = _cpu_s(pid)
        await asyncio.sleep(2.0)
        print(f"the relay takes {50 * (_cpu_s(pid) - cpu_s):.1f} % of a core in flight")
        begun_s = time.monotonic()
        os.kill(pid, number)
        latched_s = await flying.seconds_until_latched(begun_s, 6.0)
        after = await flying.px4()
        assert after.mode != "OFFBOARD" or latched_s < 1.0
        assert after.last_setpoint_mono_ns is not None
        last_s = after.last_setpoint_mono_ns / 1e9 - begun_s
        print(
            f"{number.name}: last set point {last_s:+.3f} s, latched after {latched_s:.2f} s, vehicle in {after.mode}"
        )
        assert last_s < 0.15 and latched_s < 3.0
        while _relay(flying) in (0, pid):  # noqa: ASYNC110 - it is polled
            await asyncio.sleep(0.05)
        await flying.until(lambda one: not any("relay" in text or "heartbeat" in text for text in one["not_ready"]))
        await asyncio.sleep(1.0)
        settled = await flying.px4()
        assert settled.mode not in ("OFFBOARD",) and settled.setpoints == after.setpoints, "a person engages again"
        assert (await flying.status())["state"] == "latched"
    await flying.fly()
    assert (await flying.status())["state"] in IN_OFFBOARD


async def _take_the_vehicles_key(flying: Flying) -> None:
    key_file(flying.out / "ours.key", (flying.out / "vehicle.key").read_bytes())
    if (relay := _relay(flying)) != 0:
        os.kill(relay, signal.SIGKILL)  # it reads the key when it starts
    await flying.until(lambda one: not any("sign" in text for text in one["not_ready"]))


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _relay(flying: Flying) -> int:
    return max(flying.children(RELAY), default=0)
