"""The end of a connection, with a library that hangs where the real one does."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Any

import mavsdk
import pytest

from companion.autopilot import mavsdk_link
from companion.autopilot.mavsdk_link import MavsdkLink
from companion.autopilot.port import AutopilotError


class _Library:
    """Its opening lasts until it is let go."""

    def __init__(self, *_: Any) -> None:
        self.opening, self.opened, self.let_go = threading.Event(), threading.Event(), threading.Event()
        self.destroyed_while_opening = False
        self.destroyed = threading.Event()

    def add_any_connection_with_handle(self, url: str) -> None:
        self.opening.set()
        self.let_go.wait(30)
        self.opened.set()

    def destroy(self) -> None:
        self.destroyed_while_opening = not self.opened.is_set()
        self.destroyed.set()


async def test_a_library_is_never_destroyed_while_it_opens_and_nobody_waits_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    library = _Library()
    monkeypatch.setattr(mavsdk, "Mavsdk", lambda *_: library)
    monkeypatch.setattr(mavsdk_link, "_CLOSE_TIMEOUT_S", 0.05)
    link = MavsdkLink(url="udpin://127.0.0.1:0", names=(), on_message=lambda *_: None)
    opening = asyncio.create_task(link.open(10.0))
    await asyncio.to_thread(library.opening.wait, 30)
    opening.cancel()
    with pytest.raises(asyncio.CancelledError):
        await opening
    assert not library.destroyed.is_set()
    library.let_go.set()
    assert await asyncio.to_thread(library.destroyed.wait, 30)
    assert not library.destroyed_while_opening


async def test_no_library_is_made_for_a_device_that_is_not_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delattr(mavsdk, "Mavsdk")
    with pytest.raises(AutopilotError, match="there is no device"):
        await MavsdkLink(url=f"serial://{tmp_path}/ttyS1:921600", names=(), on_message=lambda *_: None).open(1.0)
