"""The control socket: commands are answered, others are kept out, a second service is refused."""

from __future__ import annotations

import asyncio
import os
import sys
from asyncio.subprocess import PIPE, STDOUT
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from companion.errors import CompanionError
from companion.host.control_socket import ControlServer, ask
from tests.control_socket import serving


async def echo(command: str) -> dict[str, Any]:
    return {"ok": True, "got": command}


async def test_a_command_is_answered_and_the_socket_is_the_owners_alone(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    async with serving(path, echo):
        assert await ask(path, "status") == {"ok": True, "got": "status"}
        assert path.stat().st_mode & 0o777 == 0o600
    assert not path.exists()


_STRANGER = """
import os, socket, sys
os.chdir(sys.argv[1])  # the folders above it are the owner's alone
os.setuid(65534)
with socket.socket(socket.AF_UNIX) as asking:
    asking.connect("control.sock")
    asking.sendall(b'{"command": "engage"}\\n')
    print(asking.recv(1024).decode())
"""


def _let_in(path: Path, mode: int) -> None:
    path.chmod(mode)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
async def test_another_user_commands_nothing_even_where_the_file_lets_it(tmp_path: Path) -> None:
    path, heard = tmp_path / "control.sock", list[str]()

    async def note(command: str) -> dict[str, Any]:
        heard.append(command)
        return {"ok": True}

    async def stranger() -> str:
        arguments = (sys.executable, "-c", _STRANGER, str(tmp_path))
        process = await asyncio.create_subprocess_exec(*arguments, stdout=PIPE, stderr=STDOUT)
        return (await process.communicate())[0].decode()

    task = asyncio.create_task(ControlServer(path, note).run())
    while not path.exists():  # noqa: ASYNC110 - it has no event of its own
        await asyncio.sleep(0.01)
    _let_in(tmp_path, 0o711)
    assert "PermissionError" in await stranger()
    _let_in(path, 0o666)
    assert "user 65534 may not command this service" in await stranger()
    task.cancel()
    with suppress(asyncio.CancelledError):
        await task
    assert heard == []


async def test_a_path_that_can_be_no_socket_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for name, named in (("notes.txt", "it is no socket"), ("x" * 120, "AF_UNIX path too long")):
        with pytest.raises(CompanionError, match=named):
            await ControlServer(tmp_path / name, echo).run()
    with pytest.raises(CompanionError, match="cannot reach a control socket there: AF_UNIX path too long"):
        await ask(tmp_path / ("x" * 120), "engage")
    assert (tmp_path / "notes.txt").read_text() == "mine"


async def test_garbage_is_answered_with_what_would_be_right(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    async with serving(path, echo):
        reader, writer = await asyncio.open_unix_connection(path)
        for line in (b"not json\n", b"[]\n", b'{"order": 1}\n'):
            writer.write(line)
            assert b"expected one line like" in await reader.readline()
        writer.close()


async def test_a_second_service_is_refused_and_a_stale_socket_replaced(tmp_path: Path) -> None:
    path = tmp_path / "control.sock"
    async with serving(path, echo):
        with pytest.raises(CompanionError, match="another service is running"):
            await ControlServer(path, echo).run()
        assert (await ask(path, "status"))["ok"]
    path.touch()
    path.unlink()
    with pytest.raises(CompanionError, match="no service is running there"):
        await ask(path, "status")
