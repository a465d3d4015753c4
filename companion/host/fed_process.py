"""A process beside the service that is fed through a socket pair: kept alive at one end, read at the other."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import sys
from collections.abc import Callable
from typing import Final

from companion.host.child import tied

_log = logging.getLogger(__name__)
_FIRST_WAIT_S: Final = 1.0
_LONGEST_WAIT_S: Final = 30.0
_LASTED_S: Final = 60.0
"""A process that has lived for so long is started again at once when it goes."""
_DATAGRAM_BYTES: Final = 1 << 20
_AT_ONCE: Final = 64


async def keep_fed(name: str, module: str, settings: str, attach: Callable[[socket.socket], None]) -> None:
    """Runs `python -m module settings` and starts it again whenever it is gone. `attach` is given our end of each
    one's socket pair, on a thread. Never ends and never fails: what is shown is worth no flight."""
    loop, wait_s = asyncio.get_running_loop(), _FIRST_WAIT_S
    while True:
        begun_s = loop.time()
        try:
            code = await _serve(module, settings, attach)
            _log.warning("the %s's process ended with code %d; starting another", name, code)
        except OSError as error:
            _log.warning("the %s's process cannot be started: %s", name, error.strerror)
        wait_s = _FIRST_WAIT_S if loop.time() - begun_s > _LASTED_S else min(2 * wait_s, _LONGEST_WAIT_S)
        await asyncio.sleep(wait_s)


async def take_feed(feed: socket.socket, take: Callable[[bytes], None]) -> None:
    """In the process: every datagram of its end (not blocking), until nobody holds the other."""
    loop, ended = asyncio.get_running_loop(), asyncio.Event()

    def drain() -> None:
        for _ in range(_AT_ONCE):
            try:
                data = feed.recv(_DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except ConnectionError:
                data = b""
            if not data:
                loop.remove_reader(feed)
                ended.set()
                return
            take(data)

    loop.add_reader(feed, drain)
    await ended.wait()


async def _serve(module: str, settings: str, attach: Callable[[socket.socket], None]) -> int:
    """One process, until it ends; its exit code. Raises OSError."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        command = tied("nice", "-n", "5", sys.executable, "-m", module, settings)
        try:
            process = await asyncio.create_subprocess_exec(
                *command, stdin=theirs.fileno(), stdout=asyncio.subprocess.DEVNULL
            )
        except BaseException:
            ours.close()
            raise
    try:
        await asyncio.to_thread(attach, ours)
        return await process.wait()
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()
