"""The live server's own process: `python -m companion.live.server SETTINGS`, `LiveSettings` as JSON.

Channels and messages come in on standard input, a socket; the topics that somebody subscribes to go back. It may be
killed, stopped or flooded: whoever feeds it does not wait. Ends with the feed.
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys
import threading
from collections import Counter
from pathlib import Path
from typing import Any, Final

import msgspec
from aiohttp import web

from companion.errors import CompanionError, ConfigError
from companion.host.token import read_token
from companion.live.front import Front
from companion.log.live import ANNOUNCEMENT, MESSAGE, Announced

_DATAGRAM_BYTES: Final = 1 << 20
_BACKLOG: Final = 1024
"""Messages for one viewer that is slow; the oldest go first."""
TIME_NS: Final = 50_000_000
"""Viewers are told the time of the log so often, while they are told anything."""
EXTRA: Final = "foxglove.enabled: needs the library foxglove-sdk: pip install 'wsr-companion[foxglove]'"


class LiveSettings(msgspec.Struct, frozen=True, kw_only=True):
    """What the process is told by whoever starts it."""

    name: str
    address: str
    port: int
    token_file: str | None = None


class Live:
    """The server, and who subscribes to what of it."""

    def __init__(self, settings: LiveSettings, feed: socket.socket) -> None:
        """Raises CompanionError."""
        foxglove = _library()
        self._foxglove = foxglove
        self._feed = feed
        self._lock = threading.Lock()
        self._subscribers: Counter[str] = Counter()
        self._context = foxglove.Context()
        self._channels: dict[int, Any] = {}
        self._told_t_ns = 0
        live = self

        class Listener(foxglove.ServerListener):  # type: ignore[name-defined, misc]
            def on_subscribe(self, client: Any, channel: Any) -> None:
                live.count(channel.topic, 1)

            def on_unsubscribe(self, client: Any, channel: Any) -> None:
                live.count(channel.topic, -1)

        host, port = (settings.address, settings.port) if settings.token_file is None else ("127.0.0.1", 0)
        try:
            self._server = foxglove.start_server(
                name=settings.name, host=host, port=port, server_listener=Listener(), context=self._context,
                message_backlog_size=_BACKLOG, capabilities=[foxglove.websocket.Capability.Time],
            )  # fmt: skip
        except (RuntimeError, OSError) as error:
            raise CompanionError(f"port {port} at {host}: {error}") from None

    @property
    def port(self) -> int:
        return int(self._server.port)

    def count(self, topic: str, change: int) -> None:
        """On a thread of the library's."""
        with self._lock:
            self._subscribers[topic] += change
            wanted = [name for name, number in self._subscribers.items() if number > 0]
        try:
            self._feed.send(msgspec.json.encode(wanted), socket.MSG_DONTWAIT)
        except OSError:  # the service does not listen now: it asks nobody, and the next change tells all
            return

    def take(self, datagram: bytes) -> None:
        number, log_t_ns = MESSAGE.unpack_from(datagram)
        body = datagram[MESSAGE.size :]
        if number != ANNOUNCEMENT:
            channel = self._channels.get(number)
            if channel is not None:
                channel.log(body, log_time=log_t_ns)
                self._tell_time(log_t_ns)
            return
        told = msgspec.msgpack.decode(body, type=Announced)
        schema = self._foxglove.Schema(name=told.schema_name, encoding=told.schema_encoding, data=told.schema)
        self._channels[told.number] = self._foxglove.Channel(
            told.topic, schema=schema, message_encoding=told.encoding, context=self._context
        )

    def _tell_time(self, log_t_ns: int) -> None:
        """A viewer would else look frames up at its own clock's time, at which a robot that never met a time server has
        none."""
        if abs(log_t_ns - self._told_t_ns) >= TIME_NS:
            self._told_t_ns = log_t_ns
            self._server.broadcast_time(log_t_ns)

    def stop(self) -> None:
        self._server.stop()


def _library() -> Any:
    try:
        import foxglove
    except ModuleNotFoundError:
        raise ConfigError(EXTRA) from None
    return foxglove


def _serve(settings: LiveSettings, feed: socket.socket) -> None:
    """Until the feed ends. Raises CompanionError."""
    token = None if settings.token_file is None else read_token(Path(settings.token_file))
    live = Live(settings, feed)
    if token is not None:
        ready: list[CompanionError | None] = []
        begun = threading.Event()
        thread = threading.Thread(target=_run_front, args=(settings, token, live.port, ready, begun), daemon=True)
        thread.start()
        begun.wait()
        if ready[0] is not None:
            raise ready[0]
    try:
        while data := feed.recv(_DATAGRAM_BYTES):
            live.take(data)
    except ConnectionError:
        pass
    finally:
        live.stop()


def _run_front(
    settings: LiveSettings, token: str, port: int, ready: list[CompanionError | None], begun: threading.Event
) -> None:
    async def run() -> None:
        runner = web.AppRunner(Front(token, port).application(), access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        try:
            await web.TCPSite(runner, settings.address, settings.port, reuse_address=True).start()
            ready.append(None)
        except OSError as error:
            ready.append(CompanionError(f"port {settings.port} at {settings.address}: {error.strerror}"))
        begun.set()
        await asyncio.Event().wait()

    asyncio.run(run())


def main() -> None:
    settings = msgspec.json.decode(sys.argv[1], type=LiveSettings)
    with socket.socket(fileno=os.dup(0)) as feed:
        try:
            _serve(settings, feed)
        except CompanionError as error:
            print(f"companion foxglove: {error}", file=sys.stderr, flush=True)
            sys.exit(error.exit_code)


if __name__ == "__main__":
    main()
