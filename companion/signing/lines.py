"""The two ends of the signing relay, and how old what comes and goes there is. Nothing here waits.

Each end gives frames with their age [s] and takes frames with the monotonic time of their arrival [s]; what is older
than `OLDEST_S` is dropped, wherever it waited: a datagram in a socket by the kernel's stamp of its arrival, a byte in a
serial line's queue by what has drained since it was written.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
import struct
import termios
import time
import tty
from collections import deque
from pathlib import Path
from typing import Final, Protocol
from urllib.parse import urlsplit

from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S
from companion.signing.frames import FrameStream, frames_of

OLDEST_S: Final = 0.1
_MOST_AT_ONCE: Final = 64
"""Datagrams of one end before the other has its turn: a flood from outside holds up no set point."""
_SO_TIMESTAMPNS: Final = 35  # socket(7)
_TIMESPEC: Final = struct.Struct("qq")
_ANCILLARY_BYTES: Final = socket.CMSG_SPACE(_TIMESPEC.size)
_LARGEST_DATAGRAM: Final = 65536
_READ_BYTES: Final = 4096

Address = tuple[str, int]
Frames = list[tuple[bytes, float]]


class Line(Protocol):
    """Where the vehicle is."""

    def fileno(self) -> int: ...

    def receive(self) -> Frames: ...

    def send(self, frame: bytes, arrived_s: float) -> bool:
        """Whether it is on its way."""

    def greet(self, frame: bytes) -> None:
        """To whoever is there, known or not."""

    def trust(self) -> None:
        """What was received last was the vehicle's: it is where frames are sent to."""

    def drop_old(self) -> None:
        """Nothing that is too old stays in a queue."""

    def skip(self) -> None:
        """This program stood still: what has come meanwhile has no age that could be told."""

    def close(self) -> None: ...


class UdpLine:
    """`udpin`: where the vehicle sends to us, it is spoken to where what it signed came from. `udpout`: it is there."""

    def __init__(self, host: str, port: int, is_server: bool) -> None:
        """Raises AutopilotError."""
        self._socket = stamping_socket()
        self._to: Address | None = None
        self._from: Address | None = None
        self._is_server = is_server
        try:
            if is_server:
                self._socket.bind((host, port))
            else:
                self._socket.connect((host, port))
        except OSError as error:
            self._socket.close()
            what = "the port is taken by another process" if error.errno == errno.EADDRINUSE else error.strerror
            raise AutopilotError(f"udp {host}:{port}: {what}") from None

    def fileno(self) -> int:
        return self._socket.fileno()

    def receive(self) -> Frames:
        found: Frames = []
        for datagram, age_s, sender in datagrams(self._socket, 1):
            self._from = sender
            found += [(frame, age_s) for frame in frames_of(datagram)] or [(b"\0\0\0", age_s)]
        return found

    def send(self, frame: bytes, arrived_s: float) -> bool:
        return time.monotonic() - arrived_s <= OLDEST_S and self._send(frame, self._to)

    def greet(self, frame: bytes) -> None:
        self._send(frame, self._to or self._from)

    def _send(self, frame: bytes, to: Address | None) -> bool:
        try:
            if not self._is_server:
                self._socket.send(frame)
            elif to is not None:
                self._socket.sendto(frame, to)
            return not self._is_server or to is not None
        except OSError:
            return False

    def trust(self) -> None:
        self._to = self._from

    def drop_old(self) -> None:
        pass

    def skip(self) -> None:
        pass  # the kernel's stamps tell

    def close(self) -> None:
        self._socket.close()


class SerialLine:
    """Raw, 8 bits, no parity, no flow control."""

    def __init__(self, device: Path, baud: int) -> None:
        """Raises AutopilotError."""
        speed = getattr(termios, f"B{baud}", None)
        if speed is None:
            raise AutopilotError(f"serial {device}: no speed {baud}; expected one such as 57600, 115200, 921600")
        try:
            self._fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise AutopilotError(f"serial {device}: {error.strerror}") from None
        try:
            tty.setraw(self._fd)
            settings = termios.tcgetattr(self._fd)
            settings[2] = (settings[2] | termios.CLOCAL | termios.CREAD) & ~termios.CRTSCTS
            settings[4] = settings[5] = speed
            termios.tcsetattr(self._fd, termios.TCSANOW, settings)
            termios.tcflush(self._fd, termios.TCIOFLUSH)
        except termios.error as error:
            os.close(self._fd)
            raise AutopilotError(f"serial {device}: is no serial line: {error.args[-1]}") from None
        self._device = device
        self._stream = FrameStream()
        self._waits_since_s = 0.0
        """When what the stream waits to see the end of has come."""
        self._written = 0
        self._queued: deque[tuple[int, float]] = deque()
        """In the line's queue: the count of bytes with each frame's last, and when the frame arrived."""

    def fileno(self) -> int:
        return self._fd

    def receive(self) -> Frames:
        """Raises AutopilotError where the line is gone."""
        try:
            data = os.read(self._fd, _READ_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            raise AutopilotError(f"serial {self._device}: {error.strerror}") from None
        if not data:
            raise AutopilotError(f"serial {self._device}: it is gone")
        now_s = time.monotonic()
        if self._stream.waits and now_s - self._waits_since_s > OLDEST_S:
            self._stream = FrameStream()  # noise that looked like a long frame: behind it others would grow old
        passed, is_new = self._stream.passed, not self._stream.waits
        found = self._stream.feed(data)
        if is_new or self._stream.passed > passed:
            self._waits_since_s = now_s
        return [(frame, 0.0) for frame in found]

    def send(self, frame: bytes, arrived_s: float) -> bool:
        self.drop_old()
        if time.monotonic() - arrived_s > OLDEST_S:
            return False
        try:
            count = os.write(self._fd, frame)
        except OSError:  # full, or gone
            return False
        # A frame of which only a part fitted is lost: its rest would be older than the next one, and means nothing.
        self._written += count
        self._queued.append((self._written, arrived_s))
        return count == len(frame)

    def greet(self, frame: bytes) -> None:
        self.send(frame, time.monotonic())

    def trust(self) -> None:
        pass

    def drop_old(self) -> None:
        with contextlib.suppress(OSError):
            drained = self._written - _waiting(self._fd)
            while self._queued and self._queued[0][0] <= drained:
                self._queued.popleft()
            if self._queued and time.monotonic() - self._queued[0][1] > OLDEST_S:
                termios.tcflush(self._fd, termios.TCOFLUSH)
                self._queued.clear()

    def skip(self) -> None:
        with contextlib.suppress(termios.error):
            termios.tcflush(self._fd, termios.TCIFLUSH)
        self._stream = FrameStream()

    def close(self) -> None:
        os.close(self._fd)


def open_line(url: str) -> Line:
    """Raises AutopilotError."""
    parts = urlsplit(url)
    if parts.scheme in ("udpin", "udpout"):
        return UdpLine(parts.hostname or "0.0.0.0", parts.port or 0, parts.scheme == "udpin")
    device, _, baud = parts.path.partition(":")
    return SerialLine(Path(device), int(baud or 0))


def stamping_socket() -> socket.socket:
    """UDP, not waiting, with the kernel's time of arrival."""
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.setblocking(False)
    udp.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    return udp


def datagrams(udp: socket.socket, most: int = _MOST_AT_ONCE) -> list[tuple[bytes, float, Address]]:
    """What has come: bytes, age [s], sender."""
    found = []
    for _ in range(most):
        try:
            data, ancillary, _, sender = udp.recvmsg(_LARGEST_DATAGRAM, _ANCILLARY_BYTES)
        except BlockingIOError:
            break
        except OSError:  # nobody listens at the other end: told once for each datagram that was sent there
            continue
        found.append((data, _age_s(ancillary), sender))
    return found


def _age_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    """By wall time: where that is stepped back meanwhile, what waits seems new once."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            return float(max(0.0, (time.time_ns() - seconds * NS_PER_S - nanoseconds) / NS_PER_S))
    return 0.0


def _waiting(fd: int) -> int:
    """Bytes in a line's output queue."""
    return int(struct.unpack("i", fcntl.ioctl(fd, termios.TIOCOUTQ, b"\0" * 4))[0])
