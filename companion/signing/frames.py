"""MAVLink 2 message signing of whole frames, on pymavlink's implementation. No socket, no file.

mavlink.io/en/guide/message_signing: the first 48 bits of SHA-256 over key, frame, link id and a time in units of 10 us
since 2015, which rises with each frame of a sender and link.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink
from pymavlink.generator.mavcrc import x25crc

UNITS_PER_S: Final = 100_000
EPOCH_S: Final = 1_420_070_400
"""2015-01-01 in Unix time."""
_V1, _V2 = 0xFE, 0xFD
_SIGNED: Final = 1
_HEADER, _CHECKSUM, _SIGNATURE = 10, 2, 13
_LARGEST: Final = _HEADER + 255 + _CHECKSUM + _SIGNATURE

Window = tuple[int, int, int]
"""Link id, system, component of a sender."""


@dataclass(slots=True)
class Counts:
    """Of frames from the vehicle's line, and of those to it that could not be signed."""

    taken: int = 0
    unsigned: int = 0
    wrong: int = 0
    used: int = 0
    """Their time was used before."""
    unsent: int = 0


class Signing:
    """One link. `windows` are the newest times of senders known from before, `sent` our own; `now_units` the time."""

    def __init__(
        self, key: bytes, windows: Mapping[Window, int], sent: int, now_units: Callable[[], int], link_id: int = 0
    ) -> None:
        self.counts = Counts()
        self._now_units = now_units
        self._mav = mavlink.MAVLink(None)
        self._state = self._mav.signing
        self._state.secret_key = key
        self._state.link_id = link_id
        self._state.timestamp = max(sent + 1, now_units())
        self._state.stream_timestamps.update(windows)

    @property
    def sent(self) -> int:
        """The next of our own times."""
        return int(self._state.timestamp)

    def windows(self) -> dict[Window, int]:
        """A copy."""
        return dict(self._state.stream_timestamps)

    def sign(self, frame: bytes) -> bytes | None:
        """A MAVLink 2 frame with its signature; None for what is none, or of a message that pymavlink does not know."""
        kind = mavlink.mavlink_map.get(int.from_bytes(frame[7:10], "little")) if len(frame) > _HEADER else None
        if kind is None or frame[0] != _V2 or frame[2] & _SIGNED:
            self.counts.unsent += 1
            return None
        body = bytearray(frame[:-_CHECKSUM])
        body[2] |= _SIGNED
        body += _checksum(body, kind.crc_extra)
        message = mavlink.MAVLink_message(kind.id, kind.msgname)
        message._msgbuf = body
        self._state.timestamp = max(self._state.timestamp, self._now_units())
        message.sign_packet(self._mav)
        return bytes(message._msgbuf)

    def takes(self, frame: bytes) -> bool:
        """Whether a frame bears the key's signature and a time that was not used yet; counted."""
        if frame[0] != _V2 or not frame[2] & _SIGNED:
            self.counts.unsigned += 1
            return False
        window = (frame[-_SIGNATURE], frame[5], frame[6])
        stamps = self._state.stream_timestamps
        before = stamps.get(window)
        if before is not None and int.from_bytes(frame[-12:-6], "little") <= before:
            self.counts.used += 1
            return False
        if self._mav.check_signature(bytearray(frame), frame[5], frame[6]):
            self.counts.taken += 1
            return True
        # The library has moved the window already: a forged time would shut the true sender out.
        self.counts.wrong += 1
        if before is None:
            stamps.pop(window, None)
        else:
            stamps[window] = before
        return False


def frames_of(datagram: bytes) -> Iterator[bytes]:
    """The whole MAVLink frames that a datagram consists of, up to the first that is none."""
    at = 0
    while at < len(datagram):
        length = _length(datagram, at)
        if not length or at + length > len(datagram):
            return
        yield datagram[at : at + length]
        at += length


class FrameStream:
    """Frames out of a stream of bytes that may begin anywhere and hold noise: what has a wrong checksum is none."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self.passed = 0
        """Bytes that it is done with; what came after them may be the beginning of a frame, or noise that looks so."""

    @property
    def waits(self) -> bool:
        return bool(self._bytes)

    def feed(self, data: bytes) -> list[bytes]:
        self._bytes += data
        held, at, found = self._bytes, 0, []
        while at < len(held):
            if held[at] not in (_V1, _V2):
                at += 1
                continue
            length = _length(held, at)
            if not length or at + length > len(held):
                break  # not all of it is here yet
            frame = bytes(held[at : at + length])
            if _is_whole(frame):
                found.append(frame)
                at += length
            else:
                at += 1
        del held[:at]
        self.passed += at
        return found


def _length(data: bytes | bytearray, at: int) -> int:
    """Of the frame that begins there; 0 where it cannot be told."""
    if data[at] == _V2 and at + 3 <= len(data):
        return _HEADER + data[at + 1] + _CHECKSUM + (_SIGNATURE if data[at + 2] & _SIGNED else 0)
    if data[at] == _V1 and at + 2 <= len(data):
        return 6 + data[at + 1] + _CHECKSUM
    return 0


def _is_whole(frame: bytes) -> bool:
    is_v2 = frame[0] == _V2
    number = int.from_bytes(frame[7:10], "little") if is_v2 else frame[5]
    kind: Any = mavlink.mavlink_map.get(number)
    end = len(frame) - (_SIGNATURE if is_v2 and frame[2] & _SIGNED else 0)
    return kind is not None and frame[end - 2 : end] == _checksum(frame[: end - 2], kind.crc_extra)


def _checksum(body: bytes | bytearray, extra: int) -> bytes:
    crc = x25crc(bytes(body[1:]))
    crc.accumulate(bytes((extra,)))
    return int(crc.crc).to_bytes(2, "little")
