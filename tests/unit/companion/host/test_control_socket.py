"""The control socket: commands are answered, others are kept out, a second service is refused."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import socket
import sys
from asyncio.subprocess import PIPE, STDOUT
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from companion.errors import CompanionError
from companion.host import control_socket
from companion.host.control_socket import ControlServer, ask, ask_status
from tests.control_socket import serving


async def echo(command: str, target: str | None = None) -> dict[str, Any]:
    return {"ok": True, "got": command} | ({} if target is None else {"target": target})


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


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def _let_in(path: Path, mode: int) -> None:
    path.chmod(mode)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
async def test_another_user_commands_nothing_even_where_the_file_lets_it(tmp_path: Path) -> None:
    path, heard = tmp_path / "control.sock", list[str]()

    async def note(command: str, target: str | None = None) -> dict[str, Any]:
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


_MEMBER = """
import asyncio, os, sys
from pathlib import Path
from companion.errors import CompanionError
from companion.host.control_socket import ask, ask_status
os.chdir(sys.argv[1])
os.setgroups([])
os.setgid(int(sys.argv[2]))
os.setuid(65534)
async def asked(way, *words):
    try:
        return await way(*words)
    except CompanionError as error:
        return str(error)
print(asyncio.run(asked(ask, Path("control.sock"), "engage")))
print(asyncio.run(asked(ask, Path("status.sock"), "engage")))
print(asyncio.run(asked(ask_status, Path("control.sock"))))
"""


async def _as_member(folder: Path, group: int) -> list[str]:
    arguments = (sys.executable, "-c", _MEMBER, str(folder), str(group))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    process = await asyncio.create_subprocess_exec(*arguments, stdout=PIPE, stderr=STDOUT, env=environment)
    return (await process.communicate())[0].decode().splitlines()


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
async def test_the_group_may_ask_for_the_status_and_nothing_else(tmp_path: Path) -> None:
    heard = list[str]()

    async def note(command: str, target: str | None = None) -> dict[str, Any]:
        heard.append(command)
        return {"ok": True}

    server = ControlServer(tmp_path / "control.sock", note, tmp_path / "status.sock")
    await server.open()
    try:
        _let_in(tmp_path, 0o711)
        os.chown(tmp_path / "status.sock", -1, 4242)  # as where the service's own group is that one
        assert [(tmp_path / name).stat().st_mode & 0o777 for name in ("control.sock", "status.sock")] == [0o600, 0o660]
        refused, told, answered = await _as_member(tmp_path, 4242)
        assert "control.sock: permission denied" in refused
        assert "'engage' is for the service's user and root" in told
        assert answered == "{'ok': True}" and heard == ["status"]
        strangers = await _as_member(tmp_path, 65534)
        assert all("permission denied" in line for line in strangers) and heard == ["status"]
    finally:
        server.close()
    assert _names(tmp_path) == []


async def test_one_socket_that_is_taken_leaves_neither_behind(tmp_path: Path) -> None:
    (tmp_path / "status.sock").write_text("a file")
    with pytest.raises(CompanionError, match=r"status\.sock: it is no socket"):
        await ControlServer(tmp_path / "control.sock", echo, tmp_path / "status.sock").open()
    assert _names(tmp_path) == ["status.sock"]


async def test_who_may_command_asks_the_control_socket(tmp_path: Path) -> None:
    async with serving(tmp_path / "control.sock", echo):
        assert await ask_status(tmp_path / "control.sock") == {"ok": True, "got": "status"}
    with pytest.raises(CompanionError, match="no service is running there"):
        await ask_status(tmp_path / "control.sock")


async def _answered(path: Path) -> dict[str, Any]:
    while True:
        with suppress(CompanionError):
            return await ask(path, "status")
        await asyncio.sleep(0.01)


async def test_a_socket_that_was_taken_away_is_there_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(control_socket, "_WATCH_S", 0.02)
    folder = tmp_path / "run"
    path = folder / "control.sock"
    async with serving(path, echo), asyncio.timeout(10):
        shutil.rmtree(folder)
        assert (await _answered(path))["ok"]
        assert path.stat().st_mode & 0o777 == 0o600
        shutil.rmtree(folder)
        folder.touch()
        while "cannot bind" not in caplog.text:  # noqa: ASYNC110 - it has no event of its own
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.1)
        folder.unlink()
        assert (await _answered(path))["ok"]
    assert not path.exists()
    assert caplog.text.count("cannot bind") == 1


async def test_a_socket_that_is_anothers_by_now_is_left_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control_socket, "_WATCH_S", 0.02)
    path = tmp_path / "control.sock"
    first = ControlServer(path, echo)
    await first.open()
    path.unlink()
    async with serving(path, echo), asyncio.timeout(10):
        task = asyncio.create_task(first.run())
        await asyncio.sleep(0.1)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        assert await ask(path, "status") == {"ok": True, "got": "status"}


async def test_a_command_may_name_a_robot(tmp_path: Path) -> None:
    async with serving(tmp_path / "control.sock", echo):
        named = await ask(tmp_path / "control.sock", "engage", target="beta")
        assert named == {"ok": True, "got": "engage", "target": "beta"}
        reader, writer = await asyncio.open_unix_connection(tmp_path / "control.sock")
        for line, answer in (
            (b'{"command": "engage", "target": 7}', {"ok": True, "got": "engage", "target": "7"}),
            (b'["engage"]', {"ok": False, "error": 'expected one line like {"command": "status"}'}),
        ):
            writer.write(line + b"\n")
            assert json.loads(await reader.readline()) == answer
        writer.close()


class _Slow:
    """Takes its time, and notes what it has begun and done."""

    def __init__(self, takes_s: float = 0.3) -> None:
        self.takes_s = takes_s
        self.begun: list[str] = []
        self.done: list[str] = []

    async def answer(self, command: str, target: str | None = None) -> dict[str, Any]:
        if command == "hello":
            return {"ok": True}
        self.begun.append(command)
        await asyncio.sleep(self.takes_s)
        self.done.append(command)
        return {"ok": True}


def _said_and_gone(path: Path, command: str) -> None:
    with socket.socket(socket.AF_UNIX) as asking:
        asking.connect(str(path))
        asking.sendall(json.dumps({"command": command}).encode() + b"\n")


async def test_who_has_gone_engages_nobody_when_a_service_that_stood_still_goes_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, slow = tmp_path / "control.sock", _Slow()
    async with serving(path, slow.answer):
        for command in ("engage", "abort"):  # while the loop stands still, as in a stopped or suspended service
            _said_and_gone(path, command)
        await asyncio.sleep(0.8)
    assert slow.begun == slow.done == ["abort"], "an abort is never too late"
    assert "engage: not done; whoever asked did not wait for the answer" in caplog.text


async def test_who_gives_up_while_it_is_looked_at_engages_nobody(tmp_path: Path) -> None:
    path, slow = tmp_path / "control.sock", _Slow(2.0)
    async with serving(path, slow.answer):
        with pytest.raises(CompanionError, match="does not answer"):
            await ask(path, "engage", timeout_s=0.2)
        await asyncio.sleep(2.5)
    assert (slow.begun, slow.done) == (["engage"], [])


async def test_who_has_said_all_and_waits_is_answered(tmp_path: Path) -> None:
    """As `echo ... | socat - UNIX-CONNECT:...` does."""
    path, slow = tmp_path / "control.sock", _Slow()
    async with serving(path, slow.answer):
        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(b'{"command": "engage"}\n')
        writer.write_eof()
        assert json.loads(await reader.readline()) == {"ok": True}
        writer.close()
    assert slow.done == ["engage"]
