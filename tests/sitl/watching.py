"""Waits for what a running service tells of itself, and keeps what the world says is true."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from companion.errors import CompanionError
from companion.host.control_socket import ask
from companion.sim import truth
from companion.sim.truth import WorldTruth


async def until(control: Path, condition: Callable[[dict[str, Any]], bool], timeout_s: float = 90.0) -> None:
    """Until the status holds what is waited for. Raises TimeoutError."""
    async with asyncio.timeout(timeout_s):
        while True:
            await asyncio.sleep(0.1)
            with suppress(CompanionError):  # not listening yet
                if condition(await ask(control, "status")):
                    return


async def listen(sock: socket.socket, truths: list[WorldTruth]) -> None:
    """Adds each truth of the world, until it is cancelled."""
    while True:
        truths.append(truth.decode_world(await asyncio.get_running_loop().sock_recv(sock, 4096)))
