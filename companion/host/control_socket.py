"""The local control socket: one JSON line asks, one answers. Engaging is a person's act and comes only here."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import struct
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from companion.errors import CompanionError

Handler = Callable[[str], Awaitable[dict[str, Any]]]
_UCRED = struct.Struct("3i")
_LINE_BYTES = 1 << 20


class ControlServer:
    """Listens on a Unix socket that only its owner (or root) may use, and gives each command to `handler`."""

    def __init__(self, path: Path, handler: Handler) -> None:
        self._path = path
        self._handler = handler
        self._server: asyncio.Server | None = None

    async def open(self) -> None:
        """Listens from now on. Raises CompanionError when another service holds the socket, or it cannot be made."""
        await self._refuse_second_service()
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._server = await asyncio.start_unix_server(self._serve, self._path, limit=_LINE_BYTES)
            self._path.chmod(0o600)
        except OSError as error:
            self.close()
            raise CompanionError(f"{self._path}: cannot bind the control socket: {error.strerror or error}") from None

    async def run(self) -> None:
        """Serves until cancelled; opens what is not open yet, and raises as that does."""
        if self._server is None:
            await self.open()
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            self.close()

    def close(self) -> None:
        """Harmless when repeated. Waits for nobody: since Python 3.12 a server waits for its clients to leave."""
        server, self._server = self._server, None
        if server is not None:
            server.close()
            self._path.unlink(missing_ok=True)

    async def _refuse_second_service(self) -> None:
        try:
            _, writer = await asyncio.open_unix_connection(self._path)
        except FileNotFoundError:
            return
        except ConnectionRefusedError:
            if not self._path.is_socket():
                raise CompanionError(f"{self._path}: it is no socket; expected a path for the control socket") from None
            self._path.unlink(missing_ok=True)
            return
        except OSError as error:
            raise CompanionError(f"{self._path}: cannot bind the control socket: {error.strerror or error}") from None
        writer.close()
        raise CompanionError(f"{self._path}: another service is running on this control socket")

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(ConnectionError, ValueError):
            while line := await reader.readline():
                writer.write(json.dumps(await self._answer(line, writer)).encode() + b"\n")
                await writer.drain()
        writer.close()

    async def _answer(self, line: bytes, writer: asyncio.StreamWriter) -> dict[str, Any]:
        peer: socket.socket = writer.get_extra_info("socket")
        _, uid, _ = _UCRED.unpack(peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size))
        if uid not in (0, os.getuid()):
            return {"ok": False, "error": f"user {uid} may not command this service"}
        try:
            command = json.loads(line)["command"]
        except (ValueError, KeyError, TypeError, RecursionError):
            return {"ok": False, "error": 'expected one line like {"command": "status"}'}
        return await self._handler(str(command))


async def ask(path: Path, command: str, timeout_s: float = 5.0) -> dict[str, Any]:
    """Sends one command and returns the answer. Raises CompanionError when no service answers there."""
    try:
        async with asyncio.timeout(timeout_s):
            reader, writer = await asyncio.open_unix_connection(path, limit=_LINE_BYTES)
            writer.write(json.dumps({"command": command}).encode() + b"\n")
            line = await reader.readline()
            writer.close()
            answer = json.loads(line)
    except (FileNotFoundError, ConnectionRefusedError):
        raise CompanionError(f"{path}: no service is running there") from None
    except PermissionError:
        raise CompanionError(f"{path}: permission denied; run as the service's user or root") from None
    except (TimeoutError, ConnectionError, ValueError, RecursionError):
        raise CompanionError(f"{path}: the service does not answer") from None
    except OSError as error:
        raise CompanionError(f"{path}: cannot reach a control socket there: {error.strerror or error}") from None
    if not isinstance(answer, dict):
        raise CompanionError(f"{path}: what answers there is no service of this program")
    return answer
