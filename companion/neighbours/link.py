"""The UDP socket that datagrams leave and enter by: broadcast or multicast, on the interface that was configured.

It is opened anew when the network has taken it away.
"""

from __future__ import annotations

import errno
import logging
import os
import socket
import struct
from pathlib import Path
from typing import Final

from companion.config.schema import Config
from companion.core.clock import NS_PER_S
from companion.errors import CompanionError
from companion.host.coalescing import AT_ONCE, Drain, Readers
from csi_bridge.arrival import StampedSocket

_log = logging.getLogger(__name__)
_RECEIVE_BYTES: Final = 2048
_SYSFS: Final = Path("/sys/class/net")
_IFF_UP: Final = 1
_LOOK_NS: Final = NS_PER_S
_PASSING: Final = frozenset({errno.EAGAIN, errno.ENOBUFS, errno.ENOMEM, errno.EINTR, errno.ECONNREFUSED})
"""A datagram that is lost, as on any radio link; the socket is sound."""


class Link:
    """The UDP socket on the neighbours' port.

    An interface that was unplugged comes back as another one, of which a socket bound to the first never hears, and a
    multicast membership goes with it. So once a second `watch` looks whether the interface is the same, and whether
    what was sent left; where not, the socket is opened anew until it works.
    """

    def __init__(self, config: Config) -> None:
        """Raises CompanionError when the socket cannot be had."""
        neighbours = config.neighbours
        self._to = (neighbours.broadcast, neighbours.port)
        self._interface = neighbours.interface
        self._attached: tuple[Readers, Drain] | None = None
        self._looked_ns: int | None = None
        self._index = 0
        self._failure = ""
        self._unopened = ""
        self.unsent = 0
        """Datagrams the network would not take."""
        self.opened = 0
        """Times the socket was opened anew."""
        self.problem = ""
        """Why robots cannot be heard or reached; empty while they can, as far as this host knows."""
        self._socket: socket.socket = self._open()
        self._stamped = StampedSocket(self._socket)

    def fileno(self) -> int:
        return self._socket.fileno()

    def attach(self, readers: Readers, drain: Drain) -> None:
        """`drain` is called when something has arrived, whichever socket it is by then."""
        self._attached = readers, drain
        readers.add_reader(self.fileno(), drain, is_deep=True)

    def drain(self) -> list[bytes]:
        """As `arrivals`, without their times."""
        return [data for data, _ in self.arrivals()]

    def arrivals(self) -> list[tuple[bytes, int | None]]:
        """What has arrived, at most so much that other work is not held up; and when, on CLOCK_MONOTONIC [ns], None
        where that is not known."""
        arrived: list[tuple[bytes, int | None]] = []
        for _ in range(AT_ONCE):
            try:
                data, _, arrived_ns = self._stamped.receive(_RECEIVE_BYTES)
            except BlockingIOError:
                break
            except OSError as error:  # what became of the interface is told to who receives, too
                self._note(error)
                break
            arrived.append((data, arrived_ns))
        return arrived

    def send(self, data: bytes) -> bool:
        """Whether the network took it."""
        try:
            self._socket.sendto(data, self._to)
        except OSError as error:
            self.unsent += 1
            self._note(error)
            return False
        return True

    def watch(self, now_ns: int) -> None:
        """Once a second: opens the socket anew where it must be."""
        if self._looked_ns is not None and now_ns - self._looked_ns < _LOOK_NS:
            return
        self._looked_ns = now_ns
        failure, self._failure = self._failure or self._unopened, ""
        if not failure and self._interface is not None and _index(self._interface) != self._index:
            failure = f"interface {self._interface} is another one, or gone"
        if failure:
            self._unopened = self._renew()
            failure = self._unopened or failure  # a new socket has to show that it works
        elif self._interface is not None:
            failure = _not_up(self._interface)
        self._tell(failure)

    def close(self) -> None:
        self._detach()
        self._socket.close()

    def _note(self, error: OSError) -> None:
        if error.errno not in _PASSING:
            self._failure = f"{self._to[0]}: {error.strerror}"

    def _tell(self, problem: str) -> None:
        """Each change once."""
        if problem and not self.problem:
            _log.warning("the robots' network: %s; trying again every second", problem)
        elif self.problem and not problem:
            _log.warning("the robots' network is back")
        self.problem = problem

    def _renew(self) -> str:
        """Why there is no new socket; empty when there is one."""
        try:
            fresh = self._open()
        except CompanionError as error:
            return str(error)
        self._detach()
        self._socket.close()
        self._socket, self._stamped = fresh, StampedSocket(fresh)
        self.opened += 1
        if self._attached is not None:
            self.attach(*self._attached)
        return ""

    def _detach(self) -> None:
        if self._attached is not None and self._socket.fileno() >= 0:
            self._attached[0].remove_reader(self._socket.fileno())

    def _open(self) -> socket.socket:
        """Raises CompanionError."""
        address, port = self._to
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # each robot of a simulation hears each
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        opened.setblocking(False)
        index = 0 if self._interface is None else _index(self._interface)
        if index is None:
            opened.close()
            raise CompanionError(f"neighbours.interface {self._interface}: there is no such interface")
        try:
            _choose_interface(opened, address, self._interface, index)
            # Bound to the group or broadcast address itself: nothing sent to one host only is taken for a broadcast.
            opened.bind(self._to)
        except OSError as error:
            opened.close()
            raise CompanionError(
                f"neighbours.broadcast {address}, port {port}: {error.strerror}; expected the broadcast address of a "
                "network of this host, or a multicast group with neighbours.interface"
            ) from None
        self._index = index
        return opened


def _choose_interface(opened: socket.socket, address: str, interface: str | None, index: int) -> None:
    """Raises OSError where the kernel refuses."""
    if _is_multicast(address):
        # Without an interface the kernel takes that of the route to the group, if it has any.
        member = socket.inet_aton(address) + socket.inet_aton("0.0.0.0") + struct.pack("@i", index)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, member)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    elif interface is not None:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, os.fsencode(interface))


def _index(interface: str) -> int | None:
    """The kernel's number of an interface, another one each time it is plugged in; None where there is none."""
    try:
        return socket.if_nametoindex(interface)
    except OSError:
        return None


def _not_up(interface: str) -> str:
    """Why nothing leaves by an interface; empty where the kernel says nothing of the kind."""
    folder = _SYSFS / interface
    try:
        if not int((folder / "flags").read_text(), 16) & _IFF_UP:
            return f"interface {interface} is down"
        return "" if int((folder / "carrier").read_text()) else f"interface {interface} has no carrier"
    except (OSError, ValueError):
        return ""


def _is_multicast(address: str) -> bool:
    return 224 <= int(address.split(".")[0]) <= 239
