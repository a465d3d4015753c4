"""The service with faults built in, for tests: `python -m tests.faults.service --config FILE`.

It is `companion run` in every other respect. Orders come as text datagrams on `faults.sock` in its runtime directory:

    block SECONDS      the event loop stands still (time.sleep)
    raise TASK         the task of that name raises
    wall SECONDS       the wall clock is stepped, as this process sees it
    suspend SECONDS    the host was suspended, as this process sees it: CLOCK_BOOTTIME has gone on, no other clock
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import socket
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

from companion import app
from companion.config.file import load_config
from companion.host.unix_datagram import bind_datagram_socket

_bombs: dict[str, asyncio.Event] = {}
_create_task = asyncio.TaskGroup.create_task


class Bomb(RuntimeError):
    """What a test makes a task raise."""


async def _armed(work: Coroutine[Any, Any, Any], name: str) -> Any:
    """The task's own work, until it ends or a test makes it fail."""
    bomb = _bombs.setdefault(name, asyncio.Event())
    inner, fuse = asyncio.ensure_future(work), asyncio.ensure_future(bomb.wait())
    try:
        await asyncio.wait({inner, fuse}, return_when=asyncio.FIRST_COMPLETED)
        if fuse.done():
            raise Bomb(f"a test made task {name} fail")
        return await inner
    finally:
        fuse.cancel()
        inner.cancel()
        await asyncio.gather(inner, fuse, return_exceptions=True)


def _create_armed(group: asyncio.TaskGroup, work: Any, *, name: str | None = None, context: Any = None) -> Any:
    return _create_task(group, _armed(work, name) if name else work, name=name, context=context)


def _step_wall_clock(seconds: float) -> None:
    true_s, true_ns = time.time, time.time_ns
    time.time = lambda: true_s() + seconds
    time.time_ns = lambda: true_ns() + round(seconds * 1e9)


def _suspend(seconds: float) -> None:
    true_ns = time.clock_gettime_ns
    time.clock_gettime_ns = lambda clock: true_ns(clock) + (round(seconds * 1e9) if clock == time.CLOCK_BOOTTIME else 0)


def _obey(orders: socket.socket) -> None:
    command, argument = orders.recv(1024).decode().split(maxsplit=1)
    if command == "block":
        time.sleep(float(argument))
    elif command == "wall":
        _step_wall_clock(float(argument))
    elif command == "suspend":
        _suspend(float(argument))
    elif command == "raise":
        _bombs.setdefault(argument, asyncio.Event()).set()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--config", type=Path, required=True)
    config = load_config(parser.parse_args().config)
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    asyncio.TaskGroup.create_task = _create_armed  # type: ignore[method-assign,assignment]
    with bind_datagram_socket(config.path("faults.sock")) as orders:
        app.run_service(config, lambda: asyncio.get_running_loop().add_reader(orders.fileno(), _obey, orders))


if __name__ == "__main__":
    main()
