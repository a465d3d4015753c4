"""The UDP socket that datagrams leave and enter by: broadcast or multicast, on the interface that was configured."""

from __future__ import annotations

import socket
import struct
from typing import Final

from companion.config.schema import Config
from companion.errors import CompanionError

_RECEIVE_BYTES: Final = 2048
_AT_ONCE: Final = 256


class Link:
    """The UDP socket on the neighbours' port, for `loop.add_reader`."""

    def __init__(self, config: Config) -> None:
        """Raises CompanionError when the socket cannot be had."""
        neighbours = config.neighbours
        self._to = (neighbours.broadcast, neighbours.port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # each robot of a simulation hears each
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._socket.setblocking(False)
        self._buffer = bytearray(_RECEIVE_BYTES)
        self.unsent = 0
        """Datagrams the network would not take."""
        try:
            self._choose_interface(neighbours.broadcast, neighbours.interface)
            # Bound to the group or broadcast address itself: nothing sent to one host only is taken for a broadcast.
            self._socket.bind(self._to)
        except OSError as error:
            self._socket.close()
            raise CompanionError(
                f"neighbours.broadcast {neighbours.broadcast}, port {neighbours.port}: {error.strerror}; expected the "
                "broadcast address of a network of this host, or a multicast group with neighbours.interface"
            ) from None

    def fileno(self) -> int:
        return self._socket.fileno()

    def drain(self) -> list[bytes]:
        """What has arrived, at most so much that other work is not held up."""
        arrived: list[bytes] = []
        view = memoryview(self._buffer)
        for _ in range(_AT_ONCE):
            try:
                size = self._socket.recv_into(self._buffer)
            except BlockingIOError:
                break
            arrived.append(bytes(view[:size]))
        return arrived

    def send(self, data: bytes) -> None:
        try:
            self._socket.sendto(data, self._to)
        except OSError:  # no route, no buffer: a radio link loses datagrams anyway
            self.unsent += 1

    def close(self) -> None:
        self._socket.close()

    def _choose_interface(self, address: str, interface: str | None) -> None:
        """Raises CompanionError for an interface that is not there, OSError where the kernel refuses."""
        try:
            index = 0 if interface is None else socket.if_nametoindex(interface)
        except OSError:
            self._socket.close()
            raise CompanionError(f"neighbours.interface {interface}: there is no such interface") from None
        if _is_multicast(address):
            # Without an interface the kernel takes that of the route to the group, if it has any.
            member = socket.inet_aton(address) + socket.inet_aton("0.0.0.0") + struct.pack("@i", index)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, member)
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        elif interface is not None:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode())


def _is_multicast(address: str) -> bool:
    return 224 <= int(address.split(".")[0]) <= 239
