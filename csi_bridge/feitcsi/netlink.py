"""Reports as the patched iwlwifi sends them: vendor events of nl80211, unicast to the socket that asked for them.

Asking needs root (CAP_NET_ADMIN). Measuring itself is switched on in debugfs, `iwlwifi/*/iwlmvm/csi_enabled`.
"""

from __future__ import annotations

import errno
import os
import socket
from pathlib import Path
from typing import Final

from csi_bridge.draining import Draining
from csi_bridge.feitcsi.message import FAMILY_NAME, VENDOR_COMMAND, decode_event, encode_event, subscription
from csi_bridge.feitcsi.records import FEITCSI_CODE
from csi_bridge.generic_netlink import NETLINK_GENERIC, family_number, request
from csi_bridge.netlink import DEFAULT_CONNECTOR_IDX, NetlinkError, grow

_PORT_IDS: Final = 0xFE17_0000
_KERNEL_PORT_ID: Final = 0
_ANSWER_S: Final = 2.0
_SOCKETS: Final = Path("/proc/net/netlink")


class VendorEventSource(Draining):
    """Reports of the card of `interface`.

    With `require_kernel_sender` the kernel must have nl80211 and take the subscription, and messages of any other
    process are counted and dropped. Without it a process that may (root) can send reports too, to the port of `idx`,
    and a kernel without nl80211 is none the worse. Raises NetlinkError.
    """

    def __init__(
        self,
        interface: str | None,
        require_kernel_sender: bool = True,
        receive_buffer_bytes: int = 4 << 20,
        idx: int = DEFAULT_CONNECTOR_IDX,
    ) -> None:
        self._kernel_only = require_kernel_sender
        super().__init__(_open(0 if require_kernel_sender else _PORT_IDS | idx), self._record)
        self._family: int | None = None
        try:
            grow(self._socket, receive_buffer_bytes)
            if require_kernel_sender or interface is not None:
                self._family = _subscribe(self._socket, interface)
        except NetlinkError:
            if require_kernel_sender:
                self._socket.close()
                raise
        self._socket.setblocking(False)

    def _record(self, datagram: bytes, sender: tuple[int, int]) -> tuple[int, bytes] | None:
        is_kernel = sender[0] == _KERNEL_PORT_ID
        if self._kernel_only and not is_kernel:
            return None
        return FEITCSI_CODE, decode_event(datagram, self._family if is_kernel else None)


class VendorEventFeeder:
    """Sends reports to a source that takes them from others than the kernel: for the simulator, `feed` and tests. Needs
    root."""

    def __init__(self, idx: int = DEFAULT_CONNECTOR_IDX) -> None:
        self._port_id = _PORT_IDS | idx
        self._socket = _open(0)
        self._socket.setblocking(False)
        self.dropped = 0

    def send(self, code: int, body: bytes) -> bool:
        """False when nobody listens, when there was no room, or for a record of another card. Raises NetlinkError when
        sending is not permitted."""
        try:
            if code == FEITCSI_CODE:
                self._socket.sendto(encode_event(body), (self._port_id, 0))
                return True
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.ENOBUFS, errno.ECONNREFUSED):
                raise _refusal("sending a vendor event", error) from None
        self.dropped += 1
        return False

    def close(self) -> None:
        self._socket.close()


def port_has_listener(idx: int) -> bool | None:
    """Whether any process takes reports at the port of `idx`; None where /proc/net/netlink cannot be read."""
    try:
        rows = [line.split() for line in _SOCKETS.read_text().splitlines()[1:]]
        return any(int(row[1]) == NETLINK_GENERIC and int(row[2]) == _PORT_IDS | idx for row in rows)
    except (OSError, ValueError, IndexError):
        return None


def vendor_events_available(idx: int = DEFAULT_CONNECTOR_IDX) -> str | None:
    """None when reports can be sent and received on this machine, else the reason why not."""
    try:
        source = VendorEventSource(None, require_kernel_sender=False, idx=idx)
        try:
            feeder = VendorEventFeeder(idx)
            try:
                return None if feeder.send(FEITCSI_CODE, b"") else "generic netlink does not deliver"
            finally:
                feeder.close()
        finally:
            source.close()
    except NetlinkError as error:
        return error.strerror or str(error)


def _open(port_id: int) -> socket.socket:
    try:
        opened = socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, NETLINK_GENERIC)
    except OSError as error:
        raise _refusal("opening generic netlink", error) from None
    try:
        opened.bind((port_id, 0))
    except OSError as error:
        opened.close()
        raise _refusal(f"taking port {port_id:#x} of generic netlink", error) from None
    opened.settimeout(_ANSWER_S)
    return opened


def _subscribe(opened: socket.socket, interface: str | None) -> int:
    """The number of nl80211's family. Raises NetlinkError."""
    if interface is None:
        raise NetlinkError(errno.EINVAL, "vendor events need the card's interface (csi.interface)")
    try:
        index = socket.if_nametoindex(interface)
    except OSError:
        raise NetlinkError(errno.ENODEV, f"{interface}: there is no such interface") from None
    try:
        family = family_number(opened, FAMILY_NAME)
        request(opened, family, VENDOR_COMMAND, subscription(index), acknowledged=True)
    except OSError as error:
        raise _refusal(f"{interface}: asking for its CSI", error) from None
    return family


def _refusal(what: str, error: OSError) -> NetlinkError:
    number = error.errno or errno.ETIMEDOUT
    hint = {
        errno.EPERM: "needs root (CAP_NET_ADMIN)",
        errno.EACCES: "needs root (CAP_NET_ADMIN)",
        errno.ENOENT: "this kernel has no nl80211: is the driver loaded?",
        errno.EOPNOTSUPP: "its driver is not FeitCSI's",
        errno.EADDRINUSE: "it is in use by another process",
    }.get(number, "needs Linux with generic netlink and FeitCSI's driver")
    return NetlinkError(number, f"{what}: {os.strerror(number)}; {hint}")
