"""What passes between the service and the process that computes the team: length-prefixed msgpack on pipes, in which
what was not observed stays infinite.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from companion.team.records import RawSighting

LENGTH: Final = struct.Struct("<I")
MAX_BYTES: Final = 1 << 22
Place = tuple[int, int, int, tuple[float, float, float]]
"""Robot, boot, time on our clock [ns], antenna in that robot's own frame [m]."""


@dataclass(frozen=True, slots=True)
class News:
    """Of one second."""

    now_ns: int
    places: list[Place]
    sightings: list[RawSighting]


def framed(message: Any) -> bytes:
    body = msgspec.msgpack.encode(message)
    return LENGTH.pack(len(body)) + body
