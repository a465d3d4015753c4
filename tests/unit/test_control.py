"""The control socket: commands are answered, others are kept out, a second service is refused."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from companion.control import ControlServer, ask
from companion.errors import CompanionError


async def echo(command: str) -> dict[str, Any]:
    return {"ok": True, "got": command}


@asynccontextmanager
async def server(path: Path) -> AsyncIterator[None]:
    task = asyncio.create_task(ControlServer(path, echo).run())
    for _ in range(200):
        await asyncio.sleep(0.01)
        with suppress(CompanionError):
            await ask(path, "hello")
            break
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


async def test_a_command_is_answered_and_the_socket_is_the_owners_alone(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    async with server(path):
        assert await ask(path, "status") == {"ok": True, "got": "status"}
        assert path.stat().st_mode & 0o777 == 0o600
    assert not path.exists()


async def test_garbage_is_answered_with_what_would_be_right(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    async with server(path):
        reader, writer = await asyncio.open_unix_connection(path)
        for line in (b"not json\n", b"[]\n", b'{"order": 1}\n'):
            writer.write(line)
            assert b"expected one line like" in await reader.readline()
        writer.close()


async def test_a_second_service_is_refused_and_a_stale_socket_replaced(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    async with server(path):
        with pytest.raises(CompanionError, match="another service is running"):
            await ControlServer(path, echo).run()
        assert (await ask(path, "status"))["ok"]
    path.touch()
    path.unlink()
    with pytest.raises(CompanionError, match="no service is running there"):
        await ask(path, "status")
