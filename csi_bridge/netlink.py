"""The kernel's netlink connector (AF_NETLINK, protocol 11): what the patched iwlwifi driver reports through.

Joining a connector group needs root (CAP_NET_ADMIN), and so does sending to one.
"""

from __future__ import annotations

import errno
import os
import socket
from collections import Counter
from pathlib import Path
from typing import Final

from csi_bridge.connector import connector_idx_of, decode_message, encode_message
from csi_bridge.draining import Draining
from csi_bridge.records import CSI_CODE, MPDU_CODE

DEFAULT_CONNECTOR_IDX: Final = 26
"""26 on kernels 4.x, 25 on old ones."""
_NETLINK_CONNECTOR: Final = 11
_SOL_NETLINK: Final = 270
_NETLINK_ADD_MEMBERSHIP: Final = 1
_SO_RCVBUFFORCE: Final = 33
_KERNEL_PORT_ID: Final = 0
_PROBED_AT_ONCE: Final = 1024
_NETLINK_SOCKETS: Final = Path("/proc/net/netlink")
CONNECTOR_GROUPS: Final = range(1, 33)


class NetlinkError(OSError):
    """The connector cannot be opened or written; the message says what it needs."""


class NetlinkSource(Draining):
    """CSI records of the driver on one connector index.

    With `require_kernel_sender` a message of any other process is counted and dropped: root processes may send to the
    group too. Raises NetlinkError where the connector is not there or not permitted.
    """

    def __init__(
        self,
        connector_idx: int = DEFAULT_CONNECTOR_IDX,
        require_kernel_sender: bool = True,
        receive_buffer_bytes: int = 1 << 20,
    ) -> None:
        self._idx = connector_idx
        self._kernel_only = require_kernel_sender
        super().__init__(_open(), self._record)
        try:
            self._socket.setsockopt(_SOL_NETLINK, _NETLINK_ADD_MEMBERSHIP, connector_idx)
        except OSError as error:
            self._socket.close()
            raise _refusal(f"joining connector group {connector_idx}", error) from None
        grow(self._socket, receive_buffer_bytes)

    def _record(self, datagram: bytes, sender: tuple[int, int]) -> tuple[int, bytes] | None:
        if self._kernel_only and sender[0] != _KERNEL_PORT_ID:
            return None
        return decode_message(datagram, self._idx)


class NetlinkFeeder:
    """Sends records to a connector group as the driver would: for the simulator and for tests. Needs root."""

    def __init__(self, connector_idx: int = DEFAULT_CONNECTOR_IDX) -> None:
        self._idx = connector_idx
        self._socket = _open()
        self.dropped = 0

    def send(self, code: int, body: bytes) -> bool:
        """False when the kernel had no room for the message. Raises NetlinkError when sending is not permitted."""
        try:
            self._socket.sendto(encode_message(self._idx, code, body), (_KERNEL_PORT_ID, 1 << (self._idx - 1)))
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.ENOBUFS):
                self.dropped += 1
                return False
            raise _refusal(f"sending to connector group {self._idx}", error) from None
        return True

    def close(self) -> None:
        self._socket.close()


class ConnectorProbe:
    """Hears every connector group at once: in which of them does a driver report? Raises NetlinkError."""

    def __init__(self) -> None:
        self._socket = _open()
        grow(self._socket, 4 << 20)
        self._draining = Draining(self._socket, self._count)
        self.heard: Counter[int] = Counter()
        """Records by connector index."""
        for group in CONNECTOR_GROUPS:
            try:
                self._socket.setsockopt(_SOL_NETLINK, _NETLINK_ADD_MEMBERSHIP, group)
            except OSError as error:
                if error.errno != errno.EINVAL:  # this kernel has fewer groups
                    self._socket.close()
                    raise _refusal(f"joining connector group {group}", error) from None

    def fileno(self) -> int:
        return self._socket.fileno()

    def drain(self) -> None:
        """Counts what has arrived."""
        self._draining.drain(_PROBED_AT_ONCE)

    def _count(self, datagram: bytes, _: object) -> tuple[int, bytes]:
        idx = connector_idx_of(datagram)
        code, body = decode_message(datagram, idx)
        self.heard[idx] += code in (CSI_CODE, MPDU_CODE)
        return code, body

    def close(self) -> None:
        self._socket.close()


def group_has_listener(connector_idx: int) -> bool | None:
    """Whether any process has joined the group, as /proc/net/netlink shows it; None where that cannot be read."""
    try:
        rows = [line.split() for line in _NETLINK_SOCKETS.read_text().splitlines()[1:]]
        joined = [int(row[3], 16) for row in rows if int(row[1]) == _NETLINK_CONNECTOR]
    except (OSError, ValueError, IndexError):
        return None
    return any(groups >> (connector_idx - 1) & 1 for groups in joined)


def connector_available(connector_idx: int = DEFAULT_CONNECTOR_IDX) -> str | None:
    """None when records can be sent and received on this machine, else the reason why not."""
    try:
        source = NetlinkSource(connector_idx, require_kernel_sender=False)
        try:
            feeder = NetlinkFeeder(connector_idx)
            try:
                feeder.send(0, b"")
            finally:
                feeder.close()
            return None if any(code == 0 for code, _ in source.drain()) else "the connector group does not deliver"
        finally:
            source.close()
    except NetlinkError as error:
        return error.strerror or str(error)


def _open() -> socket.socket:
    try:
        opened = socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK, _NETLINK_CONNECTOR)
    except OSError as error:
        raise _refusal("opening the netlink connector", error) from None
    opened.bind((0, 0))
    return opened


def grow(opened: socket.socket, receive_buffer_bytes: int) -> None:
    """As large a receive buffer as is permitted."""
    try:
        opened.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, receive_buffer_bytes)
    except PermissionError:
        # Without CAP_NET_ADMIN the kernel caps the size at net.core.rmem_max.
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer_bytes)


def _refusal(what: str, error: OSError) -> NetlinkError:
    hint = (
        "needs root (CAP_NET_ADMIN)"
        if error.errno in (errno.EPERM, errno.EACCES)
        else "needs Linux with CONFIG_CONNECTOR"
    )
    return NetlinkError(error.errno, f"{what}: {os.strerror(error.errno or 0)}; {hint}")
