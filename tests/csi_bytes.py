"""CSI logs of tests changed in place: host stamps, rates, counters of some of their records (layouts 34 and 38)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from csi_bridge.parser import STAMP


def frames(data: bytes) -> Iterator[bytearray]:
    """Each whole frame with its two bytes of length."""
    at = 0
    while at + 2 <= len(data) and (end := at + 2 + int.from_bytes(data[at : at + 2], "big")) <= len(data):
        yield bytearray(data[at:end])
        at = end


def changed(data: bytes, change: Callable[[int, bytearray], None]) -> bytes:
    """`change` gets the number and the frame of each record; what the file's end cut off is left out."""
    found = list(frames(data))
    for number, frame in enumerate(found):
        change(number, frame)
    return b"".join(map(bytes, found))


def later(data: bytes, first: int, by_s: float) -> bytes:
    """The host stamped record `first` and all behind it later by `by_s`."""

    def change(number: int, frame: bytearray) -> None:
        if number >= first:
            seconds, microseconds, mac = STAMP.unpack_from(frame, 3 + 20)
            total_us = seconds * 1_000_000 + microseconds + round(by_s * 1e6)
            STAMP.pack_into(frame, 3 + 20, *divmod(total_us, 1_000_000), mac)

    return changed(data, change)


def wide(data: bytes, numbers: range) -> bytes:
    """Records of these numbers are of 40 MHz."""

    def change(number: int, frame: bytearray) -> None:
        if number in numbers:
            frame[3 + 19] |= 0x08

    return changed(data, change)
