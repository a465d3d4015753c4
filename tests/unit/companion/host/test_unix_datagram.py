"""Sockets that take the place of a dead process's, and of nobody else's."""

from __future__ import annotations

import socket
import stat
from pathlib import Path

import pytest

from companion.errors import CompanionError
from companion.host.unix_datagram import bind_datagram_socket


def test_it_is_its_owners_alone_and_does_not_block(tmp_path: Path) -> None:
    path = tmp_path / "run" / "pose"
    with bind_datagram_socket(path) as bound, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
        with pytest.raises(BlockingIOError):
            bound.recv(1)
        sender.sendto(b"pose", str(path))
        assert bound.recv(64) == b"pose"


def test_what_a_dead_process_left_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "pose"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as dead:
        dead.bind(str(path))
    bind_datagram_socket(path).close()


def test_a_socket_in_use_is_left_to_who_has_it(tmp_path: Path) -> None:
    path = tmp_path / "pose"
    with bind_datagram_socket(path) as first, socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        with pytest.raises(CompanionError, match=f"{path}: cannot bind the socket: "):
            bind_datagram_socket(path)
        sender.sendto(b"still here", str(path))
        assert first.recv(64) == b"still here"


def test_a_place_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CompanionError, match="file/pose: cannot bind the socket"):
        bind_datagram_socket(tmp_path / "file" / "pose")
