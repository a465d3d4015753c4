"""A vehicle that demands signing: the relay's process kept running, and an autopilot behind it that says what is
wrong."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
import sys
import time
from collections import deque
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Final

import msgspec

from companion.autopilot.delegating import DelegatingAutopilot
from companion.autopilot.port import Autopilot, AutopilotError
from companion.config.schema import Config
from companion.host.beside import Beside
from companion.host.child import tied
from companion.signing.key import read_signing_key
from companion.signing.told import RelayReport, RelaySettings

_log = logging.getLogger(__name__)
RELAY: Final = "companion.signing.relay"
WAIT_S: Final = 2.0
"""Before it is started again: longer than any vehicle flies on without set points (COM_OF_LOSS_T), and than we do
without heartbeats."""
_LONGEST_WAIT_S: Final = 10.0
_LASTED_S: Final = 30.0
_SILENT_S: Final = 5.0
"""A relay that tells nothing for so long hangs, and is replaced."""
_FRESH_S: Final = 3.0
_LARGEST: Final = 65536


class SigningRelay:
    """The relay's process. Raises ConfigError where the key cannot be read."""

    def __init__(self, url: str, key_file: Path, state_dir: Path, system_id: int | None) -> None:
        read_signing_key(key_file)
        self._key_file = key_file
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        self.url: Final = f"udpin://127.0.0.1:{port}"
        """Where MAVSDK is to listen."""
        self._settings = RelaySettings(
            url=url, port=port, key_file=str(key_file), state_dir=str(state_dir), system_id=system_id or 1
        )
        self._reports: deque[tuple[float, RelayReport]] = deque()
        self._end = "it has not told anything yet"
        self.pid: int | None = None

    @property
    def report(self) -> RelayReport | None:
        """The newest; None while it tells nothing."""
        newest = self._reports[-1] if self._reports else None
        return None if newest is None or time.monotonic() - newest[0] > _FRESH_S else newest[1]

    @property
    def problem(self) -> str:
        """What keeps the vehicle's frames from us, in words; empty where nothing does, or nothing comes at all."""
        newest = self.report
        if newest is None:
            return f"the signing relay is not running: {self._end}"
        first = self._reports[0][1]
        if newest.taken > first.taken:
            return ""
        wrong, used, unsigned = (getattr(newest, name) - getattr(first, name) for name in ("wrong", "used", "unsigned"))
        if wrong:
            return f"its frames carry a signature that {self._key_file} does not make: the vehicle has another key"
        if used:
            return "its frames bear a time that was used before: replayed, or the vehicle's clock was set back"
        if unsigned:
            return "its frames are not signed: the vehicle has no key (SETUP_SIGNING), or is another one"
        return ""

    async def run(self) -> None:
        """Until cancelled; never leaves a process behind."""
        loop, wait_s = asyncio.get_running_loop(), WAIT_S
        while True:
            begun_s = loop.time()
            try:
                self._end = await self._one_life()
            except OSError as error:
                self._end = error.strerror or str(error)
            wait_s = WAIT_S if loop.time() - begun_s > _LASTED_S else min(1.5 * wait_s, _LONGEST_WAIT_S)
            _log.warning("the signing relay: %s; starting another in %.1f s", self._end, wait_s)
            await asyncio.sleep(wait_s)

    async def _one_life(self) -> str:
        """One process, until it ends or hangs: why."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        with ours:
            with theirs:
                command = tied(sys.executable, "-m", RELAY, msgspec.json.encode(self._settings).decode())
                process = await asyncio.create_subprocess_exec(
                    *command, stdin=theirs.fileno(), stdout=asyncio.subprocess.DEVNULL
                )
            self.pid, said = process.pid, ""
            try:
                async for told in _told(ours):
                    if isinstance(told, str):
                        said = told
                    else:
                        self._take(told)
                silent = process.returncode is None and not said
                return said or ("it hangs" if silent and await _lives(process) else "it has ended")
            finally:
                self.pid = None
                self._reports.clear()
                with contextlib.suppress(ProcessLookupError):
                    process.terminate()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(process.wait(), 0.5)
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()

    def _take(self, report: RelayReport) -> None:
        now_s = time.monotonic()
        if not self._reports:
            self._reports.append((now_s, RelayReport()))
        before = self._reports[-1][1]
        if (report.wrong > before.wrong) and report.taken > before.taken:
            _log.warning("%d frames with a wrong signature are on the vehicle's line", report.wrong - before.wrong)
        if report.book_failed and not before.book_failed:
            _log.error("the times of signed frames cannot be written to %s", self._settings.state_dir)
        self._reports.append((now_s, report))
        while now_s - self._reports[0][0] > _FRESH_S:
            self._reports.popleft()


def signing_relay(config: Config) -> SigningRelay | None:
    """Of a configuration with a key; None without. Raises ConfigError."""
    autopilot = config.autopilot
    if autopilot is None or autopilot.signing_key_file is None:
        return None
    key_file, state_dir = config.path(autopilot.signing_key_file), config.path(config.state_dir)
    return SigningRelay(autopilot.url, key_file, state_dir, autopilot.system_id)


class SignedAutopilot(DelegatingAutopilot):
    """Another `Autopilot` behind the relay, whose words about the link come first. The relay runs from the first use to
    `aclose`: what ends a flight still goes through it."""

    def __init__(self, autopilot: Autopilot, relay: SigningRelay) -> None:
        super().__init__(autopilot)
        self._relay = relay
        self._beside = Beside("signing relay")

    @property
    def problem(self) -> str:
        return self._relay.problem or self._autopilot.problem

    async def connect(self, timeout_s: float = 10.0) -> None:
        self._start()
        try:
            await self._autopilot.connect(timeout_s)
        except AutopilotError as error:
            raise AutopilotError(self._relay.problem or str(error)) from None

    async def run(self) -> None:
        self._start()
        await self._autopilot.run()

    async def aclose(self) -> None:
        await self._autopilot.aclose()
        await self._beside.aclose()

    def _start(self) -> None:
        if not self._beside.is_started:
            self._beside.start(self._relay.run())


async def _told(reports: socket.socket) -> AsyncIterator[RelayReport | str]:
    """Until the other end is closed, or silent for too long."""
    loop = asyncio.get_running_loop()
    while True:
        try:
            data = await asyncio.wait_for(loop.sock_recv(reports, _LARGEST), _SILENT_S)
        except (TimeoutError, OSError):
            return
        if not data:
            return
        yield msgspec.json.decode(data, type=RelayReport | str)


async def _lives(process: asyncio.subprocess.Process) -> bool:
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(process.wait(), 0.2)
    return process.returncode is None
