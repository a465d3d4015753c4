"""Datagrams of real sockets carry the time they arrived, however late they are read."""

from __future__ import annotations

import socket
import statistics
import time
from collections.abc import Callable, Iterator

import pytest

from csi_bridge.arrival import StampedSocket

Pair = tuple[socket.socket, Callable[[bytes], object]]


@pytest.fixture(params=["unix", "udp"])
def pair(request: pytest.FixtureRequest) -> Iterator[Pair]:
    """What reads, and what sends to it."""
    if request.param == "unix":
        reads, sends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    else:
        reads, sends = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        reads.bind(("127.0.0.1", 0))
        sends.connect(reads.getsockname())
    reads.setblocking(False)
    with reads, sends:
        yield reads, sends.send


def test_each_datagram_has_the_time_that_it_arrived_and_not_that_of_reading(pair: Pair) -> None:
    reads, send = pair
    stamped = StampedSocket(reads)
    _until_the_kernel_stamps(stamped, send)
    sent: list[tuple[int, int]] = []
    for number in range(5):
        before_ns = time.monotonic_ns()
        send(b"%d" % number)
        sent.append((before_ns, time.monotonic_ns()))
        time.sleep(0.005)
    time.sleep(0.05)
    read_ns, late_ns = time.monotonic_ns(), []
    for number, (before_ns, after_ns) in enumerate(sent):
        data, _, arrived_ns = stamped.receive(64)
        assert data == b"%d" % number
        assert arrived_ns is not None
        assert before_ns <= arrived_ns < read_ns
        late_ns.append(arrived_ns - after_ns)
    assert statistics.median(late_ns) < 5_000_000, "UDP may be delivered after it was sent, on a busy machine much"
    with pytest.raises(BlockingIOError):
        stamped.receive(64)


def _until_the_kernel_stamps(stamped: StampedSocket, send: Callable[[bytes], object]) -> None:
    for _ in range(500):
        send(b"first")
        time.sleep(0.002)
        read_ns = time.monotonic_ns()
        arrived_ns = stamped.receive(64)[2]
        if arrived_ns is not None and arrived_ns < read_ns:
            return
    raise AssertionError("the kernel stamps nothing")


@pytest.mark.parametrize("held_up", [1, 2, 3])
def test_who_is_held_up_between_two_clocks_knows_the_time_all_the_same(pair: Pair, held_up: int) -> None:
    reads, send = pair
    readings = 0

    def monotonic_ns() -> int:
        nonlocal readings
        readings += 1
        if readings == held_up + 1:  # the first is what the socket begins with
            time.sleep(0.03)
        return time.monotonic_ns()

    stamped = StampedSocket(reads, monotonic_ns)
    send(b"x")
    sent_ns = time.monotonic_ns()
    readings = 0
    arrived_ns = stamped.receive(64)[2]
    assert arrived_ns is not None and arrived_ns < sent_ns + 20_000_000


@pytest.mark.parametrize("step_s", [3600.0, -3600.0, 0.2])
def test_a_wall_clock_that_was_set_meanwhile_gives_no_time(pair: Pair, step_s: float) -> None:
    reads, send = pair
    step_ns = 0
    stamped = StampedSocket(reads, wall_ns=lambda: time.time_ns() + step_ns)
    with pytest.raises(BlockingIOError):
        stamped.receive(64)
    send(b"x")
    step_ns = round(step_s * 1e9)
    assert stamped.receive(64)[2] is None
    with pytest.raises(BlockingIOError):
        stamped.receive(64)


def test_a_socket_of_netlink_has_no_times_and_is_read_all_the_same() -> None:
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as reads:
        reads.bind((0, 0))
        reads.setblocking(False)
        # RTM_GETLINK with NLM_F_REQUEST | NLM_F_DUMP: a question that needs no permission.
        reads.send(bytes.fromhex("20000000120001030100000000000000" + "00" * 16))
        time.sleep(0.01)
        data, _, arrived_ns = StampedSocket(reads).receive(1 << 16)
        assert data
        assert arrived_ns is None
