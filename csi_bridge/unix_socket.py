"""A driver's bytes over a Unix datagram socket: for machines where its netlink is not permitted.

Messages of the connector and vendor events of nl80211 may come in any order: each says itself what it is.
"""

from __future__ import annotations

import errno
import socket
from pathlib import Path
from typing import Final

from csi_bridge.connector import decode_message, encode_message
from csi_bridge.draining import Draining
from csi_bridge.feitcsi.message import decode_event, encode_event
from csi_bridge.feitcsi.records import FEITCSI_CODE
from csi_bridge.generic_netlink import is_generic

UNIX_CONNECTOR_IDX: Final = 26
"""The connector index written into messages on a Unix socket, where there are no groups."""


class UnixSocketError(OSError):
    """The socket path cannot be used; the message names it."""


class UnixSource(Draining):
    """CSI records sent to the socket at `path`, which is made here and removed by `close`. It never overruns: the
    sender is refused instead.

    A socket file that nobody listens on is taken over. Raises UnixSocketError.
    """

    def __init__(self, path: str | Path, receive_buffer_bytes: int = 1 << 20) -> None:
        self._path = Path(path)
        super().__init__(
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK), _decode, is_stamped=True
        )
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer_bytes)
        try:
            remove_stale(self._path)
            self._socket.bind(str(self._path))
        except OSError as error:
            self._socket.close()
            raise UnixSocketError(
                error.errno, f"cannot make the CSI socket {self._path}: {error.strerror or error}"
            ) from None

    def close(self) -> None:
        super().close()
        self._path.unlink(missing_ok=True)


class UnixFeeder:
    """Sends records to a UnixSource. There may be no listener yet, or none any more: such records are dropped."""

    def __init__(self, path: str | Path) -> None:
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self.dropped = 0

    def send(self, code: int, body: bytes) -> bool:
        """False when nobody listens or the listener's buffer is full."""
        try:
            self._socket.sendto(_encode(code, body), self._path)
        except (BlockingIOError, ConnectionRefusedError, FileNotFoundError):
            self.dropped += 1
            return False
        return True

    def close(self) -> None:
        self._socket.close()


def _encode(code: int, body: bytes) -> bytes:
    return encode_event(body) if code == FEITCSI_CODE else encode_message(UNIX_CONNECTOR_IDX, code, body)


def _decode(datagram: bytes, _: object) -> tuple[int, bytes]:
    """Raises CsiError."""
    if is_generic(datagram):
        return FEITCSI_CODE, decode_event(datagram)
    return decode_message(datagram, UNIX_CONNECTOR_IDX)


def is_listened_on(path: str | Path) -> bool:
    """Whether a process has this socket open."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
    return True


def remove_stale(path: Path) -> None:
    """Remove the socket file of a process that is gone. Raises UnixSocketError when one listens on it."""
    if not path.is_socket():
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink(missing_ok=True)
            return
    raise UnixSocketError(errno.EADDRINUSE, "it is in use by another process")
