"""The local control socket: one JSON line asks, one answers. Engaging is a person's act and comes only here.

A second socket, for the members of the service's group, answers what changes nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import functools
import json
import logging
import os
import select
import socket
import struct
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

from companion.errors import CompanionError

_LOG = logging.getLogger(__name__)

Handler = Callable[[str, str | None], Awaitable[dict[str, Any]]]
"""Answers a command; the second is the robot that it names, if it names one."""
Answer = Callable[[bytes, asyncio.StreamWriter], Awaitable[dict[str, Any]]]
STATUS_SOCKET: Final = "status.sock"
"""Name of the status socket where the configuration gives no other."""
_UCRED = struct.Struct("3i")
_LINE_BYTES = 1 << 20
_CHANGE_NOTHING: Final = frozenset({"status"})
_WHILE_WANTED: Final = frozenset({"engage"})
"""Done only for who still waits for the answer. While this program stood still, whoever asked may have given up and
gone, and the line lies in the socket: done then, it would fly a vehicle beside which nobody expects it any more."""
_LOOK_S: Final = 0.05
_WATCH_S: Final = 1.0
_NO_COMMAND: Final = {"ok": False, "error": 'expected one line like {"command": "status"}'}


class ControlServer:
    """Listens on a Unix socket that only its owner (or root) may use, and gives each command to `handler`. At
    `status_path` every member of the service's group is answered, but `status` alone."""

    def __init__(self, path: Path, handler: Handler, status_path: Path | None = None) -> None:
        self._path = path
        self._status_path = status_path
        self._handler = handler
        self._doors: list[_Door] = []
        self._untold = True

    async def open(self) -> None:
        """Listens from now on. Raises CompanionError when another service holds a socket, or it cannot be made."""
        self._doors = [_Door(self._path, 0o600, self._answer)]
        if self._status_path is not None:
            self._doors.append(_Door(self._status_path, 0o660, self._answer_status))
        try:
            for door in self._doors:
                await door.open()
        except CompanionError:
            self.close()
            raise

    async def run(self) -> None:
        """Serves until cancelled; opens what is not open yet, and raises as that does. A socket whose file was taken
        away is made anew: nobody could end the flight by it."""
        if not self._doors:
            await self.open()
        try:
            while True:
                await asyncio.sleep(_WATCH_S)
                await self._watch()
        finally:
            self.close()

    def close(self) -> None:
        """Harmless when repeated. Waits for nobody: since Python 3.12 a server waits for its clients to leave."""
        doors, self._doors = self._doors, []
        for door in doors:
            door.close()

    async def _watch(self) -> None:
        for door in [one for one in self._doors if not one.is_there()]:
            door.close()
            try:
                await door.open()
            except CompanionError as error:
                if self._untold:
                    _LOG.error("%s; trying again every %g s", error, _WATCH_S)
                self._untold = False
            else:
                self._untold = True
                _LOG.warning("%s: the control socket was taken away; it is there again", door.path)

    async def _answer(self, line: bytes, writer: asyncio.StreamWriter) -> dict[str, Any]:
        peer: socket.socket = writer.get_extra_info("socket")
        _, uid, _ = _UCRED.unpack(peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size))
        if uid not in (0, os.getuid()):
            return {"ok": False, "error": f"user {uid} may not command this service"}
        command, target = _command_of(line)
        if command is None:
            return _NO_COMMAND
        if command in _WHILE_WANTED:
            return await self._while_wanted(command, target, peer)
        return await self._handler(command, target)

    async def _while_wanted(self, command: str, target: str | None, peer: socket.socket) -> dict[str, Any]:
        if is_gone(peer):
            return _gone(command)
        answering = asyncio.ensure_future(self._handler(command, target))
        try:
            while not (await asyncio.wait({answering}, timeout=_LOOK_S))[0]:
                if is_gone(peer):
                    return _gone(command)
            return answering.result()
        finally:
            answering.cancel()

    async def _answer_status(self, line: bytes, writer: asyncio.StreamWriter) -> dict[str, Any]:
        """Who may open the socket may ask; the file's mode decides that."""
        command, target = _command_of(line)
        if command is None:
            return _NO_COMMAND
        if command not in _CHANGE_NOTHING:
            return {"ok": False, "error": f"{command!r} is for the service's user and root; here you may ask: status"}
        return await self._handler(command, target)


class _Door:
    """One socket that is listened on, and its file."""

    def __init__(self, path: Path, mode: int, answer: Answer) -> None:
        self.path = path
        self._mode = mode
        self._answer = answer
        self._server: asyncio.Server | None = None
        self._file: tuple[int, int] | None = None

    async def open(self) -> None:
        """Raises CompanionError."""
        path = self.path
        try:
            await _refuse_second_service(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            self._server = await asyncio.start_unix_server(
                functools.partial(_serve, self._answer), path, limit=_LINE_BYTES
            )
            self._file = _identity(path)
            _permit(path, self._mode)
        except OSError as error:
            self.close()
            raise CompanionError(f"{path}: cannot bind the control socket: {error.strerror or error}") from None

    def is_there(self) -> bool:
        """Whether who opens the path reaches us."""
        return self._file is not None and _identity(self.path) == self._file

    def close(self) -> None:
        """Its file goes too, unless it is another's by now."""
        server, self._server = self._server, None
        if server is None:
            return
        with contextlib.suppress(OSError):
            if self.is_there():
                self.path.unlink(missing_ok=True)
        server.close()
        self._file = None


def _identity(path: Path) -> tuple[int, int] | None:
    """Of the file; None where there is none."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def is_gone(peer: socket.socket) -> bool:
    """Whether the other end of a stream has closed it; who has only said all that it says (`shutdown`) waits still."""
    if peer.fileno() < 0:
        return True
    poll = select.poll()
    poll.register(peer.fileno(), 0)  # which tells of POLLHUP and POLLERR alone
    return bool(poll.poll(0))


def _gone(command: str) -> dict[str, Any]:
    _LOG.warning("%s: not done; whoever asked did not wait for the answer", command)
    return {"ok": False, "error": "whoever asked did not wait for the answer"}


async def _refuse_second_service(path: Path) -> None:
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except FileNotFoundError:
        return
    except ConnectionRefusedError:
        _remove_stale(path)
        return
    writer.close()
    raise CompanionError(f"{path}: another service is running on this control socket")


def _remove_stale(path: Path) -> None:
    if not path.is_socket():
        raise CompanionError(f"{path}: it is no socket; expected a path for the control socket") from None
    path.unlink(missing_ok=True)


def _permit(path: Path, mode: int) -> None:
    path.chmod(mode)


async def _serve(answer: Answer, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    with contextlib.suppress(ConnectionError, ValueError):
        while line := await reader.readline():
            writer.write(json.dumps(await answer(line, writer)).encode() + b"\n")
            await writer.drain()
    writer.close()


def _command_of(line: bytes) -> tuple[str | None, str | None]:
    """The command, None where there is none, and the robot that is named."""
    try:
        asked = json.loads(line)
        target = asked.get("target")
        return str(asked["command"]), None if target is None else str(target)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None, None


async def ask(path: Path, command: str, timeout_s: float = 5.0, target: str | None = None) -> dict[str, Any]:
    """Sends one command, about the robot `target` if one is named, and returns the answer. Raises CompanionError when
    no service answers there."""
    asked = {"command": command} | ({} if target is None else {"target": target})
    try:
        async with asyncio.timeout(timeout_s):
            reader, writer = await asyncio.open_unix_connection(path, limit=_LINE_BYTES)
            with contextlib.closing(writer):  # also for who gives up: the service then does not do it late
                writer.write(json.dumps(asked).encode() + b"\n")
                line = await reader.readline()
            answer = json.loads(line)
    except (FileNotFoundError, ConnectionRefusedError):
        raise CompanionError(f"{path}: no service is running there") from None
    except PermissionError:
        raise CompanionError(
            f"{path}: permission denied; run as the service's user or root, and for the status as a member of its group"
        ) from None
    except (TimeoutError, ConnectionError, ValueError, RecursionError):
        raise CompanionError(f"{path}: the service does not answer") from None
    except OSError as error:
        raise CompanionError(f"{path}: cannot reach a control socket there: {error.strerror or error}") from None
    if not isinstance(answer, dict):
        raise CompanionError(f"{path}: what answers there is no service of this program")
    return answer


async def ask_status(path: Path, timeout_s: float = 5.0) -> dict[str, Any]:
    """As `ask`, of the control socket at `path` or, for whom that one is closed, of the status socket beside it."""
    beside = path.with_name(STATUS_SOCKET)
    if not os.access(path, os.R_OK | os.W_OK) and os.access(beside, os.R_OK | os.W_OK):
        path = beside
    return await ask(path, "status", timeout_s)
