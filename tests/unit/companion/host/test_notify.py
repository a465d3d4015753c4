"""What systemd is told, over the socket that it names."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

import pytest

from companion.host import notify as module
from companion.host.notify import feed_watchdog, notify


def _manager(address: str) -> socket.socket:
    opened = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    opened.bind(address)
    opened.setblocking(False)
    return opened


def test_a_state_reaches_the_socket_that_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with _manager(str(tmp_path / "notify")) as manager:
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        notify("READY=1")
        assert manager.recv(64) == b"READY=1"


def test_an_address_may_be_abstract(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    name = f"companion-{tmp_path.name}-{id(tmp_path)}"
    with _manager("\0" + name) as manager:
        monkeypatch.setenv("NOTIFY_SOCKET", "@" + name)
        notify("STOPPING=1")
        assert manager.recv(64) == b"STOPPING=1"


@pytest.mark.parametrize("address", [None, "", "/nowhere/notify"])
def test_without_a_manager_that_listens_nothing_happens(address: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    if address is not None:
        monkeypatch.setenv("NOTIFY_SOCKET", address)
    notify("READY=1")


async def test_the_watchdog_is_fed_while_the_role_is_alive_and_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    alive = iter([True, True, False, False, True])
    done = asyncio.Event()

    def is_alive() -> bool:
        try:
            return next(alive)
        except StopIteration:
            done.set()
            return False

    monkeypatch.setattr(module, "_WATCHDOG_S", 0.0)
    monkeypatch.setattr(module, "notify", told.append)
    feeding = asyncio.create_task(feed_watchdog(is_alive))
    await asyncio.wait_for(done.wait(), 10)
    feeding.cancel()
    assert told == ["WATCHDOG=1"] * 3
