"""Datagrams of a log, signed anew; those of version 2 said again as they are said now."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.neighbours import wire
from companion.replay.datagrams import resigned
from tests.datagrams import KEY, datagram
from tests.wire_example import KEY as EXAMPLE_KEY
from tests.wire_example import example

VERSION_2 = bytes.fromhex(
    """
    57 53 52 4e 02 02 02 00 cd ab 34 12 07 00 00 00
    29 00 00 00 00 00 00 00 00 f2 05 2a 01 00 00 00
    02 02 01 00 d4 30 00 00 78 ec ff ff b8 0b 00 00
    e8 03 00 00 d8 fe ff ff 10 27 00 00 23 03 00 00
    00 00 00 00 02 00 64 00 00 00 02 00 00 00 00 00
    96 cc 7f 00 86 9f 58 6e 20 a8 32 be 10 86 01 08
    20 80 a0 cb c1 39 8e 20 08 82 20 08 82 20 e8 89
    89 23 25 7d 53 83 da 33 b3 35 d4 bb 0e dc d0 64
    """
)


def test_a_log_of_version_2_says_the_same_again() -> None:
    assert resigned(VERSION_2, EXAMPLE_KEY) == wire.encode(replace(example(), echo=None, sightings=()), EXAMPLE_KEY)
    with pytest.raises(wire.WireError, match="version 2"):
        resigned(VERSION_2[:60], EXAMPLE_KEY)
    with pytest.raises(wire.VersionError, match="version 2, this program 4"):
        wire.decode(VERSION_2, [EXAMPLE_KEY])


def test_a_log_of_this_version_is_only_signed_anew() -> None:
    sent = datagram()
    assert resigned(wire.encode(sent, b"x" * 32), KEY) == wire.encode(sent, KEY)
