"""The link says when nothing leaves, counts it, and comes back by itself. With real interfaces: tests/faults."""

from __future__ import annotations

import errno
import socket
from dataclasses import replace
from typing import Any

import pytest

from companion.config.file import load_config
from companion.core.clock import NS_PER_S
from companion.neighbours import link as module
from companion.neighbours.link import Link
from companion.neighbours.sender import NeighbourSender
from companion.neighbours.wire import Role
from companion.sim.stage import free_udp_port
from csi_bridge.arrival import StampedSocket
from tests.paths import CONFIGS

_DEMO = load_config(CONFIGS / "demo-uav.yaml")


class _Mute:
    """A socket that the network was taken from."""

    def __init__(self, real: socket.socket, number: int) -> None:
        self._real = real
        self._number = number

    def sendto(self, data: bytes, to: Any) -> int:
        raise OSError(self._number, "Network is unreachable")

    def recvmsg(self, size: int, ancillary: int) -> Any:
        raise OSError(errno.ENODEV, "No such device")

    def __getattr__(self, name: str) -> Any:
        return getattr(self._real, name)


@pytest.fixture
def link() -> Any:
    made = Link(replace(_DEMO, neighbours=replace(_DEMO.neighbours, port=free_udp_port("127.0.0.1"))))
    yield made
    made.close()


def test_no_route_is_told_once_and_a_new_socket_is_tried(link: Link, caplog: pytest.LogCaptureFixture) -> None:
    link.watch(0)
    assert link.send(b"x")
    link._socket = _Mute(link._socket, errno.ENETUNREACH)  # type: ignore[assignment]
    link._stamped = StampedSocket(link._socket)
    assert not link.send(b"y")
    assert link.drain() == []
    link.watch(NS_PER_S)
    assert (link.unsent, link.opened) == (1, 1)
    assert "127.255.255.255" in link.problem
    assert link.send(b"z")
    link.watch(NS_PER_S + 1)
    assert link.problem, "a second has to pass without a failure"
    link.watch(2 * NS_PER_S)
    assert link.problem == ""
    assert len(caplog.messages) == 2


def test_a_full_buffer_is_no_problem_of_the_network(link: Link) -> None:
    link._socket = _Mute(link._socket, errno.ENOBUFS)  # type: ignore[assignment]
    assert not link.send(b"y")
    link.watch(0)
    assert (link.problem, link.opened) == ("", 0)


def test_an_interface_that_is_gone_is_told_also_to_who_sends_nothing(
    link: Link, monkeypatch: pytest.MonkeyPatch
) -> None:
    link._interface, link._index = "robots", 7
    monkeypatch.setattr(module, "_index", lambda name: None)
    for second in range(3):
        link.watch(second * NS_PER_S)
        assert link.problem == "neighbours.interface robots: there is no such interface"


def test_what_did_not_leave_is_not_counted_as_sent() -> None:
    sender = NeighbourSender(role=Role.UAV, own_id=1, key=bytes(32), pose_rate_hz=50.0, boot_id=1)
    sender.add_pose(1, (0, 0, 0), 3)
    (data,) = sender.datagrams(NS_PER_S // 2)
    assert sender.sent_bytes > 0
    sender.note_unsent(data)
    assert sender.sent_bytes == 0
