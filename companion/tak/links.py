"""How events leave: UDP multicast or unicast, an event a datagram, or a TLS connection to a TAK server, one behind the
other. What cannot be sent is dropped and counted: an event is old after a second.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import ssl
from pathlib import Path
from typing import Final, Protocol

from companion.errors import ConfigError

_log = logging.getLogger(__name__)
_CONNECT_S: Final = 10.0
_FIRST_WAIT_S: Final = 1.0
_LONGEST_WAIT_S: Final = 60.0
_WAITING_BYTES: Final = 1 << 16
_CHUNK: Final = 1 << 16
_UNHEARD_MS: Final = 10_000
"""What a server has not taken for so long ends the connection: else the kernel keeps megabytes of events, half an hour
of them, and sends these first when the network is back."""


class CotLink(Protocol):
    """Where events go. `send` neither waits nor raises."""

    sent: int
    dropped: int

    def send(self, events: list[bytes]) -> None: ...

    async def run(self) -> None:
        """Whatever keeps it open, until cancelled."""


class UdpLink:
    """To a multicast group, by `interface`'s address where there is one, to one host, or to all of a network."""

    def __init__(self, address: str, port: int, ttl: int, interface: str | None) -> None:
        self._to = address, port
        self.sent = self.dropped = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, ttl)
        if interface is not None:
            try:
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
            except OSError as error:
                self._socket.close()
                raise ConfigError(
                    f"tak.interface: {interface}: {error.strerror}; expected an address of ours"
                ) from None

    def send(self, events: list[bytes]) -> None:
        for event in events:
            try:
                self._socket.sendto(event, self._to)
                self.sent += 1
            except OSError as error:
                if not self.dropped:
                    _log.warning("%s:%d: %s", *self._to, error.strerror)
                self.dropped += 1

    async def run(self) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            self._socket.close()


class TlsLink:
    """To a TAK server, connected again when it goes."""

    def __init__(self, host: str, port: int, context: ssl.SSLContext) -> None:
        self._to = host, port
        self._context = context
        self.sent = self.dropped = 0
        self._writer: asyncio.StreamWriter | None = None

    def send(self, events: list[bytes]) -> None:
        writer = self._writer
        for event in events:
            if writer is None or writer.is_closing() or writer.transport.get_write_buffer_size() > _WAITING_BYTES:
                self.dropped += 1
            else:
                writer.write(event)
                self.sent += 1

    async def run(self) -> None:
        loop, wait_s = asyncio.get_running_loop(), _FIRST_WAIT_S
        while True:
            begun_s = loop.time()
            try:
                why = await self._stay()
            except (OSError, TimeoutError) as error:
                why = str(error) or type(error).__name__
            wait_s = _FIRST_WAIT_S if loop.time() - begun_s > _LONGEST_WAIT_S else min(2 * wait_s, _LONGEST_WAIT_S)
            _log.warning("%s:%d: %s; connecting again in %.0f s", *self._to, why, wait_s)
            await asyncio.sleep(wait_s)

    async def _stay(self) -> str:
        """Until the server ends the connection; what it says is read, so that it can go on, and thrown away."""
        async with asyncio.timeout(_CONNECT_S):
            reader, writer = await asyncio.open_connection(*self._to, ssl=self._context, server_hostname=self._to[0])
        tcp: socket.socket = writer.get_extra_info("socket")
        tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNHEARD_MS)
        self._writer = writer
        try:
            while await reader.read(_CHUNK):
                pass
            return "the server has ended the connection"
        finally:
            self._writer = None
            writer.close()
            with contextlib.suppress(OSError, TimeoutError):
                async with asyncio.timeout(1.0):
                    await writer.wait_closed()


def tls_context(ca_file: Path, cert_file: Path, key_file: Path) -> ssl.SSLContext:
    """Both ends show a certificate; the server's is of `ca_file` and names the host. Raises ConfigError."""
    try:
        context = ssl.create_default_context(ssl.Purpose.SERVER_AUTH, cafile=ca_file)
    except (OSError, ssl.SSLError) as error:
        raise ConfigError(f"tak.ca_file: {ca_file}: {error.strerror or error}; expected certificates (PEM)") from None
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        context.load_cert_chain(cert_file, key_file, password=lambda: b"")
    except (OSError, ssl.SSLError) as error:
        why = error.strerror or error
        raise ConfigError(f"tak.cert_file: {cert_file}, {key_file}: {why}; expected PEM, its key open") from None
    return context
