"""Frames onto a monitor interface: pings that the patched driver answers, over AF_PACKET with a radiotap header.

A ping is an 802.11 data frame: frame control 0x0008, duration 0xFFFF, receiver and transmitter address those that the
CSI Tool's cards listen to (00:16:EA:12:34:56), own MAC in address 3, sequence control 0, and a body that begins with
the exchange counter as u32 big-endian. So the counter is in bytes 24-27 of the frame, as the patched driver's
check_and_send_ack reads it, which are bytes 0-3 of the body; the driver stores it little-endian in its record @34.

That driver answers frames of one length only, check sum included, and so tells whom a frame is for. It sends back the
frame with its own MAC in address 3, one byte longer than it came, which nobody answers.

An AX card's driver answers nothing and reports address 2: there it is the sender's own, and address 3 names who is to
answer. Its frames go out as VHT over 20 to 160 MHz, the widest that radiotap can ask a Linux driver for.
"""

from __future__ import annotations

import errno
import os
import socket
import struct
from dataclasses import dataclass
from typing import Final

CARD_ADDRESS: Final = bytes.fromhex("0016ea123456")
COUNTER_OFFSET: Final = 24
CHECK_SUM_BYTES: Final = 4
MIN_LENGTH: Final = COUNTER_OFFSET + 4 + CHECK_SUM_BYTES
_HEADER: Final = struct.Struct("<HH6s6s6sH")
_DATA_FRAME: Final = 0x0008
_DURATION: Final = 0xFFFF
_ETH_P_ALL: Final = 3
_RADIOTAP: Final = struct.Struct("<BBHIBxHBBB")
_PRESENT: Final = 1 << 1 | 1 << 15 | 1 << 19  # flags, TX flags, MCS
_NO_ACK: Final = 0x0008
_MCS_KNOWN: Final = 0x01 | 0x02 | 0x04  # bandwidth, index, guard interval: 20 MHz, long
_VHT_RADIOTAP: Final = struct.Struct("<BBHIBxHHBB4BBBH")
_VHT_PRESENT: Final = 1 << 1 | 1 << 15 | 1 << 21  # flags, TX flags, VHT
_VHT_KNOWN: Final = 0x04 | 0x40  # guard interval, bandwidth
_VHT_BANDWIDTHS: Final = {20: 0, 40: 1, 80: 4, 160: 11}
_CAPTURE_BYTES: Final = 4096


class InjectorError(OSError):
    """The interface cannot be used; the message names it and says what it needs."""


@dataclass(frozen=True, slots=True)
class Ping:
    """A frame that was captured: who sent it and which exchange it belongs to. `length` without the check sum."""

    mac: bytes
    counter: int
    length: int
    to: bytes | None = None
    """Who is to answer, among AX cards."""


def radiotap(mcs: int) -> bytes:
    """Radiotap header for sending at an HT rate of one stream: no acknowledgement, 20 MHz, long guard interval."""
    return _RADIOTAP.pack(0, 0, _RADIOTAP.size, _PRESENT, 0, _NO_ACK, _MCS_KNOWN, 0, mcs)


def vht_radiotap(mcs: int, width_mhz: int) -> bytes:
    """The same at a VHT rate of one stream over 20, 40, 80 or 160 MHz (IEEE80211_RADIOTAP_VHT)."""
    streams = (mcs << 4 | 1, 0, 0, 0)
    return _VHT_RADIOTAP.pack(
        0, 0, _VHT_RADIOTAP.size, _VHT_PRESENT, 0, _NO_ACK,
        _VHT_KNOWN, 0, _VHT_BANDWIDTHS[width_mhz], *streams, 0, 0, 0,
    )  # fmt: skip


def ping_frame(mac: bytes, counter: int, length: int, to: bytes | None = None) -> bytes:
    """The frame without its check sum, which the card appends; `length` is that on the air, with it. With `to` it is
    one of an AX card.

    The rest of the body counts up from the counter, so that no two frames in a row are alike.
    """
    body = length - CHECK_SUM_BYTES - COUNTER_OFFSET
    if body < 4:
        raise ValueError(f"length {length} leaves no room for the counter, expected at least {MIN_LENGTH}")
    transmitter, third = (CARD_ADDRESS, mac) if to is None else (mac, to)
    head = _HEADER.pack(_DATA_FRAME, _DURATION, CARD_ADDRESS, transmitter, third, 0)
    return head + struct.pack(">I", counter & 0xFFFFFFFF) + bytes((counter + i) & 255 for i in range(body - 4))


def echo_frame(ping: Ping, mac: bytes, length: int) -> bytes:
    """The answer to a ping as the driver would send it: same counter, our MAC, one byte longer; among AX cards to who
    sent it."""
    return ping_frame(mac, ping.counter, length + 1 + CHECK_SUM_BYTES, None if ping.to is None else ping.mac)


def parse_capture(data: bytes) -> Ping | None:
    """What a monitor interface captured, radiotap header first; None for anything but a ping or its echo."""
    if len(data) < 4:
        return None
    start = data[2] | data[3] << 8
    frame = data[start:]
    if data[0] != 0 or start < 8 or len(frame) < COUNTER_OFFSET + 4:
        return None
    control, _, receiver, transmitter, third, _ = _HEADER.unpack_from(frame)
    if control != _DATA_FRAME or receiver != CARD_ADDRESS:
        return None
    mac, to = (third, None) if transmitter == CARD_ADDRESS else (transmitter, third)
    counter = int.from_bytes(frame[COUNTER_OFFSET : COUNTER_OFFSET + 4], "big")
    return Ping(mac, counter, len(frame) - _trailer(data), to)


class Injector:
    """A raw socket on a monitor interface, which sends at an HT rate or, with a width, a VHT one. Raises InjectorError
    when it cannot be had."""

    def __init__(self, interface: str, mcs: int, vht_mhz: int | None = None) -> None:
        self._interface = interface
        self._radiotap = radiotap(mcs) if vht_mhz is None else vht_radiotap(mcs, vht_mhz)
        try:
            self._socket = socket.socket(
                socket.AF_PACKET, socket.SOCK_RAW | socket.SOCK_NONBLOCK, socket.htons(_ETH_P_ALL)
            )
        except OSError as error:
            raise _refusal(interface, error) from None
        try:
            self._socket.bind((interface, 0))
        except OSError as error:
            self._socket.close()
            raise _refusal(interface, error) from None
        self.sent = 0
        self.sent_bytes = 0
        """On the air, with check sums."""
        self.unsent = 0
        """The interface had no room."""

    def fileno(self) -> int:
        return self._socket.fileno()

    def send(self, frame: bytes) -> bool:
        """False when the interface does not take the frame."""
        try:
            self._socket.send(self._radiotap + frame)
        except OSError:  # no room, or the interface is down for a moment
            self.unsent += 1
            return False
        self.sent += 1
        self.sent_bytes += len(frame) + CHECK_SUM_BYTES
        return True

    def captured(self, limit: int = 64) -> list[Ping]:
        """Pings and echoes that others sent since the last call. Raises OSError when the interface is gone."""
        pings = []
        for _ in range(limit):
            try:
                data, address = self._socket.recvfrom(_CAPTURE_BYTES)
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno == errno.ENETDOWN:
                    break
                raise
            if address[2] != socket.PACKET_OUTGOING and (ping := parse_capture(data)) is not None:
                pings.append(ping)
        return pings

    def close(self) -> None:
        self._socket.close()


def _trailer(data: bytes) -> int:
    """Bytes of check sum that a capture ends with, as its radiotap flags say (bit 0x10)."""
    present = int.from_bytes(data[4:8], "little")
    start = 8
    extended = present
    while extended & 1 << 31 and len(data) >= start + 4:
        extended = int.from_bytes(data[start : start + 4], "little")
        start += 4
    if not present & 1 << 1:
        return 0
    if present & 1:  # TSFT stands before the flags, aligned to 8 bytes
        start = (start + 7) // 8 * 8 + 8
    return CHECK_SUM_BYTES if start < len(data) and data[start] & 0x10 else 0


def _refusal(interface: str, error: OSError) -> InjectorError:
    hint = {
        errno.EPERM: "needs root (CAP_NET_RAW)",
        errno.EACCES: "needs root (CAP_NET_RAW)",
        errno.ENODEV: "there is no such interface; make one: iw phy phy0 interface add mon0 type monitor",
    }.get(error.errno or 0, "is it up, and in monitor mode?")
    return InjectorError(error.errno, f"{interface}: {os.strerror(error.errno or 0)}; {hint}")
