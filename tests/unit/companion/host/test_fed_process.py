"""The reading end of what feeds a process beside the service. That one is started again: tests of the roles."""

from __future__ import annotations

import asyncio
import socket

from companion.host.fed_process import take_feed


async def test_every_datagram_is_taken_until_the_other_end_is_gone() -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    taken: list[bytes] = []
    with theirs:
        theirs.setblocking(False)
        reading = asyncio.create_task(take_feed(theirs, taken.append))
        with ours:
            for number in range(100):
                ours.send(bytes([number]))
        await asyncio.wait_for(reading, 30.0)
    assert taken == [bytes([number]) for number in range(100)]
