"""sd_notify(3): readiness and watchdog messages to systemd, a datagram on the socket it names in the environment."""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable

_WATCHDOG_S = 1.0


def notify(state: str) -> None:
    """Sends for example "READY=1" or "WATCHDOG=1"; does nothing when systemd did not start us."""
    address = os.environ.get("NOTIFY_SOCKET")
    if not address:
        return
    if address.startswith("@"):  # abstract socket
        address = "\0" + address[1:]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sock:
        try:
            sock.sendto(state.encode(), address)
        except OSError:
            return  # a manager that does not listen must not stop the flight


async def feed_watchdog(is_alive: Callable[[], bool]) -> None:
    """Feeds systemd's watchdog while the role's own loop runs, not merely while this one does."""
    while True:
        await asyncio.sleep(_WATCHDOG_S)
        if is_alive():
            notify("WATCHDOG=1")
