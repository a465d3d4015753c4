"""Real sockets read in turns: few wakes, every datagram, in order; those without stamps still read at once."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from companion.host import coalescing as module
from companion.host.coalescing import CoalescedReaders

_PERIOD_S = 0.05


class _Inlet:
    """One socket pair and what was read from it, each batch by itself."""

    def __init__(self) -> None:
        self.ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.ours.setblocking(False)
        self.batches: list[list[bytes]] = []
        self.read_s: list[float] = []
        self.on_batch: Callable[[], None] = lambda: None

    def drain(self, most: int = 1000) -> int:
        batch: list[bytes] = []
        while len(batch) < most:
            try:
                batch.append(self.ours.recv(64))
            except BlockingIOError:
                break
        if batch:
            self.batches.append(batch)
            self.read_s.append(time.monotonic())
            self.on_batch()
        return len(batch)

    @property
    def read(self) -> list[bytes]:
        return [data for batch in self.batches for data in batch]

    def close(self) -> None:
        self.ours.close()
        self.theirs.close()


@contextmanager
def _inlets(count: int) -> Iterator[list[_Inlet]]:
    made = [_Inlet() for _ in range(count)]
    try:
        yield made
    finally:
        for one in made:
            one.close()


def _watched(loop: asyncio.AbstractEventLoop, *inlets: _Inlet) -> list[bool]:
    selector: Any = loop
    return [inlet.ours.fileno() in selector._selector.get_map() for inlet in inlets]


async def test_a_stream_is_read_in_batches_whole_and_in_order() -> None:
    with _inlets(2) as inlets:
        readers = CoalescedReaders(asyncio.get_running_loop(), _PERIOD_S)
        for inlet in inlets:
            readers.add_reader(inlet.ours.fileno(), inlet.drain)
        sent = [b"%d" % number for number in range(120)]
        for data in sent:
            for inlet in inlets:
                inlet.theirs.send(data)
            await asyncio.sleep(0.005)
        await asyncio.sleep(3 * _PERIOD_S)
        for inlet in inlets:
            assert inlet.read == sent
            assert len(inlet.batches) <= len(sent) / 3, "some ten wait in each period, however busy the machine"
        assert _watched(asyncio.get_running_loop(), *inlets) == [True, True], "after silence"


async def _polled(readers: CoalescedReaders, *inlets: _Inlet) -> None:
    """Until something was found in each at a turn."""
    for _ in range(100):
        for inlet in inlets:
            inlet.theirs.send(b"x")
        await asyncio.sleep(0.005)
        if not any(_watched(asyncio.get_running_loop(), *inlets)):
            return
    raise AssertionError("still watched")


async def test_the_first_after_silence_is_read_at_once_and_later_ones_wait() -> None:
    with _inlets(1) as (inlet,):
        readers = CoalescedReaders(asyncio.get_running_loop(), _PERIOD_S)
        readers.add_reader(inlet.ours.fileno(), inlet.drain)
        inlet.theirs.send(b"first")
        await asyncio.sleep(0.02)
        assert inlet.read == [b"first"]
        await _polled(readers, inlet)
        readers._period_s = 1e9
        await _turned(inlet)
        inlet.theirs.send(b"waits")
        await asyncio.sleep(0.02)
        assert inlet.read[-1] == b"x"
        readers.read()
        assert inlet.read[-1] == b"waits", "or for whoever needs the newest"
        readers.remove_reader(inlet.ours.fileno())


async def _turned(inlet: _Inlet) -> None:
    """Until the next turn."""
    inlet.theirs.send(b"x")
    before = len(inlet.read)
    for _ in range(100):
        await asyncio.sleep(0.005)
        if len(inlet.read) > before:
            return
    raise AssertionError("no turn")


async def test_a_sender_that_was_late_may_send_all_at_once() -> None:
    """More than a Unix socket holds: it had been found empty, so each wakes us."""
    with _inlets(2) as (steady, late):
        readers = CoalescedReaders(asyncio.get_running_loop(), _PERIOD_S)
        for inlet in (steady, late):
            readers.add_reader(inlet.ours.fileno(), inlet.drain)
        await _polled(readers, steady, late)
        for _ in range(100):
            steady.theirs.send(b"x")
            await asyncio.sleep(0.005)
            if _watched(asyncio.get_running_loop(), late)[0]:
                break
        before = len(late.batches)
        for _ in range(4):
            late.theirs.send(b"late")
            await asyncio.sleep(0)
            await asyncio.sleep(0)
        assert len(late.batches) - before >= 2, "none waits for a turn"
        for inlet in (steady, late):
            readers.remove_reader(inlet.ours.fileno())


async def test_of_a_socket_without_stamps_the_first_behind_each_turn_is_read_at_once() -> None:
    with _inlets(2) as (stamped, unstamped):
        readers = CoalescedReaders(asyncio.get_running_loop(), _PERIOD_S)
        readers.add_reader(stamped.ours.fileno(), stamped.drain)
        readers.add_reader(unstamped.ours.fileno(), unstamped.drain, is_stamped=False)
        await _polled(readers, stamped)
        readers._period_s = 1e9
        await _turned(stamped)
        for data in (b"1", b"2"):
            unstamped.theirs.send(data)
            await asyncio.sleep(0.02)
        assert unstamped.read == [b"1"]
        for inlet in (stamped, unstamped):
            readers.remove_reader(inlet.ours.fileno())


async def test_where_a_drain_has_left_some_they_are_read_without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "AT_ONCE", 40)
    with _inlets(1) as (inlet,):
        readers = CoalescedReaders(asyncio.get_running_loop(), _PERIOD_S)
        readers.add_reader(inlet.ours.fileno(), lambda: inlet.drain(40))
        await _polled(readers, inlet)
        sent = [b"%d" % number for number in range(100)]
        for data in sent:
            inlet.theirs.send(data)
        await asyncio.sleep(2 * _PERIOD_S)
        assert inlet.read[-100:] == sent
        assert [len(batch) for batch in inlet.batches[-3:-1]] == [40, 40]
        assert inlet.read_s[-1] - inlet.read_s[-3] < _PERIOD_S
        readers.remove_reader(inlet.ours.fileno())


@pytest.mark.parametrize("is_polled", [False, True])
async def test_it_ends_cleanly_watched_or_polled(is_polled: bool) -> None:
    loop = asyncio.get_running_loop()
    with _inlets(2) as inlets:
        readers = CoalescedReaders(loop, _PERIOD_S)
        for inlet in inlets:
            readers.add_reader(inlet.ours.fileno(), inlet.drain)
        if is_polled:
            await _polled(readers, *inlets)
        for inlet in inlets:
            readers.remove_reader(inlet.ours.fileno())
            readers.remove_reader(inlet.ours.fileno())
            inlet.theirs.send(b"after")
        await asyncio.sleep(2 * _PERIOD_S)
        assert b"after" not in inlets[0].read + inlets[1].read
        assert _watched(loop, *inlets) == [False, False]


async def test_one_that_closes_another_or_fails_stops_no_other() -> None:
    loop, told = asyncio.get_running_loop(), list[dict[str, Any]]()
    loop.set_exception_handler(lambda _, context: told.append(context))
    with _inlets(3) as (closes, closed, fails):
        readers = CoalescedReaders(loop, 0.01)
        closes.on_batch = lambda: readers.remove_reader(closed.ours.fileno())

        def fail() -> int:
            if fails.drain():
                raise OSError("no such card")
            return 0

        readers.add_reader(fails.ours.fileno(), fail)
        readers.add_reader(closes.ours.fileno(), closes.drain)
        readers.add_reader(closed.ours.fileno(), closed.drain)
        for number in range(3):
            for inlet in (fails, closes, closed):
                inlet.theirs.send(b"%d" % number)
            await asyncio.sleep(0.03)
        assert (len(closes.read), len(fails.read), closed.read) == (3, 3, [])
        assert [str(context["exception"]) for context in told] == 3 * ["no such card"]
        for inlet in (fails, closes):
            readers.remove_reader(inlet.ours.fileno())


class _Loop:
    """What an event loop was asked for."""

    def add_reader(self, fd: int, callback: Callable[..., None], *args: object) -> None:
        self.watched[fd] = lambda: callback(*args)

    def remove_reader(self, fd: int) -> None:
        self.watched.pop(fd, None)

    def __init__(self) -> None:
        self.watched: dict[int, Callable[[], None]] = {}
        self.turns: list[Callable[[], None]] = []
        self.now_s, self.due_s = 7.03, 0.0

    def time(self) -> float:
        return self.now_s

    def call_at(self, when_s: float, callback: Callable[[], None]) -> object:
        self.due_s = when_s
        self.turns.append(callback)
        return callback

    def turn(self) -> None:
        """When it is due, less what a timer may be early."""
        self.now_s = self.due_s - 1e-5
        self.turns.pop()()


def test_where_nothing_may_wait_each_datagram_is_read_when_it_comes() -> None:
    loop, may_wait, taken = _Loop(), False, list[int]()
    readers = CoalescedReaders(loop, _PERIOD_S, may_wait=lambda: may_wait)  # type: ignore[arg-type]

    def drain() -> int:
        taken.append(7)
        return 1

    readers.add_reader(7, drain)
    for _ in range(5):
        loop.watched[7]()
    assert len(taken) == 5 and not loop.turns, "in flight no turn is waited for"
    may_wait = True
    loop.watched[7]()
    loop.turn()
    assert len(taken) == 7 and 7 not in loop.watched and len(loop.turns) == 1, "at rest the next turn reads"
    may_wait = False
    loop.turn()
    assert len(taken) == 8 and 7 in loop.watched and not loop.turns, (
        "a flight begins: watched again, nothing left behind"
    )


def test_a_deep_socket_is_not_watched_while_there_are_turns() -> None:
    loop, waits = _Loop(), {7: 1, 8: 0}
    readers = CoalescedReaders(loop, _PERIOD_S)  # type: ignore[arg-type]
    readers.add_reader(7, lambda: waits[7])
    readers.add_reader(8, lambda: waits[8], is_deep=True)
    loop.watched[7]()
    loop.turn()
    assert not loop.watched
    waits[7] = 0
    loop.turn()
    assert set(loop.watched) == {7, 8} and not loop.turns, "nothing arrives any more: the first wakes us again"
    waits[7] = 1
    loop.watched[7]()
    assert 8 in loop.watched
    loop.watched[8]()
    assert 8 not in loop.watched, "what comes before the first turn waits for it, and wakes us once"


class _Queue:
    """A socket's queue, and what was made of it."""

    def __init__(self) -> None:
        self.waiting: list[int] = []
        self.gathered: list[int] = []
        self.drained: list[int] = []
        self.sent = 0

    def send(self, count: int = 1) -> None:
        self.waiting += range(self.sent, self.sent + count)
        self.sent += count

    def gather(self) -> int:
        count, self.gathered, self.waiting = len(self.waiting), self.gathered + self.waiting, []
        return count

    def drain(self) -> int:
        self.gather()
        count, self.drained, self.gathered = len(self.gathered), self.drained + self.gathered, []
        return count


def test_between_looks_datagrams_are_gathered_and_worked_out_at_the_look() -> None:
    loop, queue, armed = _Loop(), _Queue(), False
    readers = CoalescedReaders(loop, _PERIOD_S, 2, lambda: not armed)  # type: ignore[arg-type]
    readers.add_reader(7, queue.drain, gather=queue.gather)
    queue.send()
    loop.watched[7]()
    assert queue.drained == [0], "after silence at once"
    for _ in range(10):
        queue.send(5)
        loop.turn()
        is_look = round(loop.now_s / _PERIOD_S) % 2 == 0
        assert (not queue.gathered) == is_look and not queue.waiting and 7 not in loop.watched
        assert queue.drained + queue.gathered == list(range(queue.sent))
    if queue.gathered:
        loop.turn()
    assert not queue.gathered
    loop.turn()
    assert not loop.turns and 7 in loop.watched, "silence again"
    queue.send()
    loop.watched[7]()
    queue.send(3)
    armed = True
    loop.turn()
    assert queue.drained == list(range(queue.sent)) and 7 in loop.watched and not loop.turns, "a flight begins"
    queue.send()
    loop.watched[7]()
    assert queue.drained == list(range(queue.sent)), "and each is worked out as it comes"


def test_many_in_a_short_queue_are_gathered_sooner_and_what_is_gathered_does_not_stay() -> None:
    loop, queue = _Loop(), _Queue()
    loop.now_s = 7.0
    readers = CoalescedReaders(loop, _PERIOD_S, 2)  # type: ignore[arg-type]
    readers.add_reader(7, queue.drain, gather=queue.gather)
    queue.send()
    loop.watched[7]()
    assert loop.due_s == pytest.approx(7.05)
    queue.send(11)
    loop.turn()
    assert len(queue.gathered) == 11 and loop.due_s == pytest.approx(7.075, abs=1e-4), "half a period for twice as many"
    loop.turn()
    assert len(queue.gathered) == 11 and loop.due_s == pytest.approx(7.1), "nothing came, but something is kept"
    queue.send()
    loop.watched[7]()
    assert len(queue.gathered) == 12, "what comes late in a burst has room"
    loop.turn()
    assert queue.drained == list(range(13)), "at the look"
    queue.send(2)
    readers.read()
    assert queue.drained == list(range(15)), "or for whoever needs the newest"
