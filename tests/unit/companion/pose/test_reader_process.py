"""The camera's reader is started again when it ends or falls silent, and never left behind."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import math
import sys
from pathlib import Path

import pytest

from companion.core.clock import MonotonicClock
from companion.errors import CompanionError
from companion.pose import reader_process
from companion.pose.reader_process import ReaderProcess
from tests.manual_clock import ManualClock

_SLEEPS = (sys.executable, "-c", "import time; time.sleep(60)")


async def _until(holds: object) -> None:
    assert callable(holds)
    async with asyncio.timeout(60):
        while not holds():  # noqa: ASYNC110 - a process tells nobody
            await asyncio.sleep(0.01)


def _is_gone(pid: int) -> bool:
    return not Path(f"/proc/{pid}").exists()


async def test_one_that_ends_is_started_again_with_longer_and_longer_waits(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    reader = ReaderProcess(("sh", "-c", f"echo x >> {tmp_path}/begun; exit 3"), ManualClock(), lambda: 0.0)
    running = asyncio.create_task(reader.run())
    await _until(lambda: len(caplog.messages) >= 4)
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    told = [message.split(" ended with code 3; starting another in ") for message in caplog.messages[:4]]
    assert [wait for _, wait in told] == ["1.0 s", "2.0 s", "4.0 s", "4.0 s"]
    assert len((tmp_path / "begun").read_text().split()) >= 4


async def test_one_that_cannot_be_started_is_tried_again(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    monkeypatch.setattr(asyncio, "create_subprocess_exec", refuse)
    running = asyncio.create_task(ReaderProcess(_SLEEPS, ManualClock(), lambda: 0.0).run())
    await _until(lambda: len(caplog.messages) >= 2)
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    assert "pose reader cannot be started: Resource temporarily unavailable; starting another" in caplog.text


async def test_one_that_is_silent_is_replaced(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(reader_process, "_SILENT_S", 0.1)
    monkeypatch.setattr(reader_process, "_LOOK_S", 0.02)
    reader = ReaderProcess(_SLEEPS, MonotonicClock(), lambda: math.inf)
    life = await reader._one_life()
    assert life.endswith("is silent (last pose: never)")
    assert _is_gone(int(life.split()[0]))
    assert reader.pid is None


async def test_nothing_is_left_of_it_when_the_service_ends() -> None:
    reader = ReaderProcess(_SLEEPS, MonotonicClock(), lambda: 0.0)
    running = asyncio.create_task(reader.run())
    await _until(lambda: reader.pid is not None)
    pid = reader.pid
    assert pid is not None
    assert not _is_gone(pid)
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    assert _is_gone(pid)


async def test_one_that_ignores_the_signal_is_killed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(reader_process, "_STOP_S", 0.05)
    deaf = (
        "import signal, pathlib, time; signal.signal(15, signal.SIG_IGN);"
        f"pathlib.Path({str(tmp_path / 'deaf')!r}).touch(); time.sleep(60)"
    )
    reader = ReaderProcess((sys.executable, "-c", deaf), MonotonicClock(), lambda: 0.0)
    running = asyncio.create_task(reader.run())
    await _until((tmp_path / "deaf").exists)
    pid = reader.pid
    assert pid is not None
    running.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await running
    assert _is_gone(pid)


def test_a_program_that_is_not_there_is_named_at_the_start() -> None:
    with pytest.raises(CompanionError, match=r"^pose\.reader_command no-such-reader: no such program$"):
        ReaderProcess(("no-such-reader", "--x"), ManualClock(), lambda: 0.0).check()
    ReaderProcess((), ManualClock(), lambda: 0.0).check()
