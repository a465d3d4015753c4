"""The camera's reader as a child of the service: started, and started again whenever it ends or falls silent."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import shutil
from collections.abc import Callable, Sequence

from companion.core.clock import NS_PER_S, Clock
from companion.errors import CompanionError
from companion.host.child import tied

_log = logging.getLogger(__name__)
_FIRST_WAIT_S = 0.5
_LONGEST_WAIT_S = 4.0
_LOOK_S = 0.25
_SILENT_S = 10.0
"""A T265 takes up to 7 s to come back by itself; a reader that is silent for longer hangs."""
_STEADY_S = 30.0
_STOP_S = 1.0


class ReaderProcess:
    """`pose_age_s` tells how long no pose has come; a reader that lives and delivers nothing is replaced too."""

    def __init__(self, command: Sequence[str], clock: Clock, pose_age_s: Callable[[], float]) -> None:
        self._command = list(command)
        self._clock = clock
        self._pose_age_s = pose_age_s
        self.pid: int | None = None

    def check(self) -> None:
        """Raises CompanionError when there is no such program."""
        if self._command and shutil.which(self._command[0]) is None:
            raise CompanionError(f"pose.reader_command {self._command[0]}: no such program")

    async def run(self) -> None:
        """Until cancelled; never leaves a process behind. Raises CompanionError when there is no such program."""
        self.check()
        wait_s = _FIRST_WAIT_S
        while True:
            started_ns = self._clock.now_ns()
            reason = await self._one_life()
            lived_s = (self._clock.now_ns() - started_ns) / NS_PER_S
            wait_s = _FIRST_WAIT_S if lived_s > _STEADY_S else min(2 * wait_s, _LONGEST_WAIT_S)
            _log.warning("pose reader %s; starting another in %.1f s", reason, wait_s)
            await self._sleep(wait_s)

    async def _one_life(self) -> str:
        try:
            process = await asyncio.create_subprocess_exec(*tied(*self._command), stdin=asyncio.subprocess.DEVNULL)
        except OSError as error:  # no memory, or no process more: the flight goes on as without poses
            return f"cannot be started: {error.strerror}"
        self.pid = process.pid
        silent_ns: int | None = None
        try:
            while process.returncode is None:
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(process.wait(), _LOOK_S)
                now_ns, age_s = self._clock.now_ns(), self._pose_age_s()
                silent_ns = None if age_s < 1.0 else silent_ns or now_ns
                if silent_ns is not None and now_ns - silent_ns > _SILENT_S * NS_PER_S:
                    age = "never" if math.isinf(age_s) else f"{age_s:.0f} s ago"
                    return f"{process.pid} is silent (last pose: {age})"
            return f"{process.pid} ended with code {process.returncode}"
        finally:
            self.pid = None
            await _end(process)

    async def _sleep(self, seconds: float) -> None:
        await self._clock.sleep_until_ns(self._clock.now_ns() + round(seconds * NS_PER_S))


async def _end(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.terminate()
    try:
        await asyncio.wait_for(process.wait(), _STOP_S)
    except TimeoutError:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()
