"""A control socket with answers of a test's own."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path

from companion.errors import CompanionError
from companion.host.control_socket import ControlServer, Handler, ask


@asynccontextmanager
async def serving(path: Path, handler: Handler) -> AsyncIterator[None]:
    """Answers at `path` from here on; a first command, "hello", has been answered already."""
    task = asyncio.create_task(ControlServer(path, handler).run())
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
