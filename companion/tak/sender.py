"""The process that tells TAK: a feed on standard input, events out, until the feed ends.

Started by `python -m companion.tak.sender SETTINGS`, `TakSettings` as JSON. It may be killed, stopped or cut off:
whoever feeds it does not wait, and nothing comes back.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import socket
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec

from companion.errors import CompanionError
from companion.host.fed_process import take_feed
from companion.tak.events import xml
from companion.tak.links import CotLink, TlsLink, UdpLink, tls_context
from companion.tak.picture import Picture, Telling

_SILENT_S: Final = 5.0
"""Of a service that says nothing for longer nothing is told either."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TakSettings:
    """What the process is told by whoever starts it; as `TakConfig`, with paths made whole."""

    transport: str
    address: str
    port: int
    ttl: int
    interface: str | None
    ca_file: str
    cert_file: str
    key_file: str
    period_s: float
    telling: Telling


def open_link(settings: TakSettings) -> CotLink:
    """Raises ConfigError."""
    if settings.transport == "udp":
        return UdpLink(settings.address, settings.port, settings.ttl, settings.interface)
    files = (Path(name) for name in (settings.ca_file, settings.cert_file, settings.key_file))
    return TlsLink(settings.address, settings.port, tls_context(*files))


def main() -> None:
    logging.basicConfig(format="companion tak: %(message)s", stream=sys.stderr)
    settings = msgspec.json.decode(sys.argv[1], type=TakSettings)
    with socket.socket(fileno=os.dup(0)) as feed:
        feed.setblocking(False)
        try:
            asyncio.run(_serve(settings, feed))
        except CompanionError as error:
            print(f"companion tak: {error}", file=sys.stderr, flush=True)
            sys.exit(error.exit_code)


async def _serve(settings: TakSettings, feed: socket.socket) -> None:
    """Until the feed ends."""
    link, picture = open_link(settings), Picture(settings.telling)
    loop = asyncio.get_running_loop()
    heard_s = loop.time()

    def take(data: bytes) -> None:
        nonlocal heard_s
        heard_s = loop.time()
        message = json.loads(data)
        picture.take(message["topic"], message["t_ns"], message["data"])

    async def tell() -> None:
        while True:
            await asyncio.sleep(settings.period_s)
            if loop.time() - heard_s < _SILENT_S:
                now = datetime.now(UTC)
                link.send([xml(event, now) for event in picture.events()])

    async with asyncio.TaskGroup() as tasks:
        others = [tasks.create_task(link.run()), tasks.create_task(tell())]
        await take_feed(feed, take)
        for task in others:
            task.cancel()


if __name__ == "__main__":
    main()
