"""Unix datagram sockets that replace a stale file of a dead process but never one that is in use."""

from __future__ import annotations

import socket
from pathlib import Path

from companion.errors import CompanionError
from csi_bridge.unix_socket import remove_stale


def bind_datagram_socket(path: Path, receive_buffer_bytes: int = 1 << 20) -> socket.socket:
    """A bound, non-blocking AF_UNIX datagram socket, readable by its owner only.

    Raises CompanionError when another process holds `path`, or when it cannot be made.
    """
    bound = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        remove_stale(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        bound.bind(str(path))
        path.chmod(0o600)
    except OSError as error:
        bound.close()
        raise CompanionError(f"{path}: cannot bind the socket: {error.strerror or error}") from None
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer_bytes)
    bound.setblocking(False)
    return bound
