"""The service's end: frames are taken, what is none is counted, and an end is not waited for."""

from __future__ import annotations

import asyncio
import socket

from companion.camera.sighting import TagFrame, encode
from companion.camera.source import TagSource

_FRAME = TagFrame(t_mono_ns=5, family="tag36h11", tags=())


async def _turn() -> None:
    for _ in range(5):
        await asyncio.sleep(0.002)


async def test_frames_are_taken_from_each_process_that_begins() -> None:
    taken: list[TagFrame] = []
    source = TagSource(taken.append)
    for round_ in (1, 2):
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        await asyncio.to_thread(source.attach, ours)
        theirs.send(encode(_FRAME))
        theirs.send(b"no frame")
        theirs.send(encode(_FRAME))
        await _turn()
        assert (len(taken), source.malformed) == (2 * round_, round_)
        theirs.close()
        await _turn()
        assert ours.fileno() == -1, "closed with its process"
    source.close()


async def test_what_is_attached_anew_closes_what_was() -> None:
    source = TagSource(lambda frame: None)
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)]
    for ours, _ in pairs:
        source.attach(ours)
        await _turn()
    assert pairs[0][0].fileno() == -1 and pairs[1][0].fileno() != -1
    source.close()
    source.close()
    for _, theirs in pairs:
        theirs.close()
