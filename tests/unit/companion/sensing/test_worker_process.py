"""The AOA worker as a real process: it answers, and when it hangs or dies it is replaced and the request refused."""

from __future__ import annotations

import asyncio
import errno
import math
import os
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.sensing import worker_process
from companion.sensing.worker import is_compiled
from companion.sensing.worker_process import AoaProcess, compile_kernel
from companion.sensing.worker_wire import AoaResult
from wsr.aperture import Aperture, make_aperture
from wsr.channel import wavelength_m
from wsr.crb.informativeness import informativeness
from wsr.estimators import ESTIMATORS
from wsr.geometry import direction

LAMBDA_M = wavelength_m(108)


def aperture(azimuth_rad: float = 0.7, polar_rad: float = 1.4) -> Aperture:
    s = np.linspace(0, 1, 300)
    p_m = np.stack([s, 0.2 * np.sin(6 * s), 0.2 * np.cos(6 * s)], axis=1)
    phase = 4 * np.pi / LAMBDA_M * (p_m @ direction(azimuth_rad, polar_rad))
    return make_aperture(s, p_m, np.exp(1j * phase), LAMBDA_M)


class Client:
    def __init__(self, timeout_s: float) -> None:
        self.results: asyncio.Queue[AoaResult] = asyncio.Queue()
        self.process = AoaProcess("bartlett", timeout_s)
        self.process.answers.connect(self.results.put_nowait)

    async def ask(self) -> AoaResult:
        self.process.submit(2, aperture())
        async with asyncio.timeout(60):
            return await self.results.get()


@asynccontextmanager
async def client(timeout_s: float) -> AsyncIterator[Client]:
    started = Client(timeout_s)
    task = asyncio.create_task(started.process.run())
    try:
        async with asyncio.timeout(120):
            await started.process.ready.wait()
        yield started
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


def workers() -> list[int]:
    """Process ids of our children that are AOA workers."""
    own = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()
    return [int(pid) for pid in own if b"companion.sensing.worker" in Path(f"/proc/{pid}/cmdline").read_bytes()]


def _numbers(value: Any) -> list[float]:
    """All numbers of an estimate, in order; what is no number must not differ in kind."""
    if isinstance(value, dict):
        return [number for key in sorted(value) for number in _numbers(value[key])]
    if isinstance(value, (list, tuple)):
        return [number for item in value for number in _numbers(item)]
    return [math.inf if value is None else float(value)]


async def test_an_aperture_gives_the_same_estimate_as_in_process() -> None:
    async with client(timeout_s=10) as asking:
        result = await asking.ask()
        (pid,) = workers()
        assert os.getpriority(os.PRIO_PROCESS, pid) == min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10)
    estimate, profile = ESTIMATORS["bartlett"]().estimate(aperture())
    # To the precision of the kernel's float32: the worker's algebra runs on one thread, ours on all.
    assert result.estimate is not None
    assert _numbers(asdict(result.estimate)) == pytest.approx(_numbers(asdict(estimate)), rel=1e-4, abs=1e-6)
    told = informativeness(aperture(), estimate.azimuth_rad, estimate.polar_rad)
    assert result.informativeness is not None
    assert asdict(result.informativeness) == pytest.approx(asdict(told), rel=1e-3, abs=1e-6)
    np.testing.assert_allclose(np.frombuffer(result.profile, np.float16).reshape(180, 360), profile.power, atol=1e-3)
    assert workers() == []


async def test_a_killed_worker_is_replaced() -> None:
    async with client(timeout_s=10) as asking:
        assert (await asking.ask()).estimate is not None
        (pid,) = workers()
        os.kill(pid, signal.SIGKILL)
        refused = await asking.ask()
        assert refused.refusal == "the AOA worker died"
        assert (await asking.ask()).estimate is not None
        assert asking.process.restarts == 1


async def test_a_hanging_worker_is_replaced_in_time() -> None:
    async with client(timeout_s=0.5) as asking:
        (pid,) = workers()
        os.kill(pid, signal.SIGSTOP)
        refused = await asking.ask()
        assert refused.refusal == "the AOA worker did not answer in time"
        assert (await asking.ask()).estimate is not None
        assert pid not in workers()


@pytest.mark.parametrize("number", [pytest.param(signal.SIGSTOP, marks=pytest.mark.long), signal.SIGKILL])
async def test_an_idle_worker_that_hangs_or_dies_is_noticed_and_replaced(number: signal.Signals) -> None:
    """Though nobody has asked it anything."""
    told: list[bool] = []
    process = AoaProcess("bartlett", 0.7)
    process.readiness.connect(told.append)
    task = asyncio.create_task(process.run())
    async with asyncio.timeout(120):
        await process.ready.wait()
        await asyncio.sleep(1.2)
        assert told == [True] and process.restarts == 0, "it answers while it is well"
        (pid,) = workers()
        os.kill(pid, number)
        while process.ready.is_set():  # noqa: ASYNC110 - it has no event for that
            await asyncio.sleep(0.01)
        await process.ready.wait()
    assert told == [True, False, True] and process.restarts == 1 and pid not in workers()
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task


async def test_one_that_cannot_be_started_is_tried_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(worker_process, "_AGAIN_S", 0.01)
    start, refused = asyncio.create_subprocess_exec, list[int]()

    async def refuse(*arguments: Any, **options: Any) -> asyncio.subprocess.Process:
        if len(refused) < 3:
            refused.append(errno.ENOMEM)
            raise OSError(errno.ENOMEM, "Cannot allocate memory")
        return await start(*arguments, **options)

    monkeypatch.setattr(asyncio, "create_subprocess_exec", refuse)
    async with client(timeout_s=60) as started:
        assert (await started.ask()).estimate is not None
    assert caplog.text.count("cannot be started: Cannot allocate memory") == 1


@pytest.mark.parametrize("sent", [b"\xff\xff\xff\xff", b"\1\0\0\0\xc1", b"\2\0\0\0{}"])
async def test_one_whose_answer_is_none_has_died(sent: bytes) -> None:
    process = await asyncio.create_subprocess_exec("printf", "%b", repr(sent)[2:-1], stdout=asyncio.subprocess.PIPE)
    with pytest.raises(ConnectionError):
        await worker_process._receive(process)
    await process.communicate()


async def test_a_backlog_drops_the_oldest_request() -> None:
    results: list[AoaResult] = []
    process = AoaProcess("bartlett", 1, waiting=2)
    process.answers.connect(results.append)
    ids = [process.submit(2, aperture()) for _ in range(3)]
    assert results == []  # an answer is an event of its own
    await asyncio.sleep(0)
    assert [(result.id, result.refusal) for result in results] == [(ids[0], "the AOA worker is behind")]


@pytest.mark.long
async def test_a_kernel_is_compiled_before_it_is_needed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert not is_compiled()
    await compile_kernel("robust")
    assert is_compiled()
