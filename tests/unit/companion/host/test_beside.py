"""What fails beside the service ends nothing but itself."""

from __future__ import annotations

import asyncio

import pytest

from companion.host.beside import Beside


async def _fails() -> None:
    raise RuntimeError("lens cap")


async def test_a_failure_is_told_and_closing_is_harmless(caplog: pytest.LogCaptureFixture) -> None:
    beside = Beside("tag camera")
    await beside.aclose()
    beside.start(_fails())
    await asyncio.sleep(0)
    await beside.aclose()
    await beside.aclose()
    assert "the tag camera has failed: RuntimeError('lens cap'); the service goes on without it" in caplog.text


async def test_a_task_that_is_closed_has_ended_and_may_begin_anew(caplog: pytest.LogCaptureFixture) -> None:
    ended = []

    async def work(number: int) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(0)
            ended.append(number)

    beside = Beside("page")
    for number in (1, 2):
        beside.start(work(number))
        assert beside.is_started
        await asyncio.sleep(0)
        await beside.aclose()
        assert not beside.is_started
    assert ended == [1, 2]
    assert caplog.text == ""
