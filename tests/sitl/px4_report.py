"""What the mock answers."""

from __future__ import annotations

import msgspec

from companion.sim.px4.report import Px4Report


def decode(datagram: bytes) -> Px4Report:
    return msgspec.msgpack.decode(datagram, type=Px4Report)
