"""The service's end of the team's process: told once a second, started again when it is gone. Nothing waits for it, and
nothing that flies depends on it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sys
from collections.abc import Callable
from math import degrees
from typing import Any, Final

import msgspec

from companion.core.clock import age_s
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.core.streams import TEAM
from companion.host.beside import Beside
from companion.host.child import tied
from companion.team.news import LENGTH, MAX_BYTES, News, framed
from companion.team.records import TeamState

_log = logging.getLogger(__name__)
WORKER: Final = "companion.team.worker"
_PERIOD_S: Final = 1.0
_WAITING_BYTES: Final = 1 << 18
"""So much may wait for a process that is slow or stopped; what comes beyond is dropped and counted."""
_FIRST_WAIT_S: Final = 1.0
_LONGEST_WAIT_S: Final = 30.0
_LASTED_S: Final = 60.0
_OLD_S: Final = 5.0
_ONE_THREAD: Final = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


class TeamProcess:
    """`news` is asked once a second, on the event loop; what comes back is recorded, and shown by `status`."""

    def __init__(
        self, *, own: int, names: dict[int, str], clock: EventClock, recorder: Recorder, news: Callable[[int], News]
    ) -> None:
        self._own = own
        self._names = names
        self._clock = clock
        self._recorder = recorder
        self._news = news
        self._process: asyncio.subprocess.Process | None = None
        self._beside = Beside("team")
        self._state: TeamState | None = None
        self.dropped = 0
        """Seconds of news that the process did not take in time."""
        self.restarts = 0

    def start(self) -> None:
        """Beside the service's tasks and not one of them: what fails here ends nothing else."""
        self._beside.start(self._run())

    async def aclose(self) -> None:
        """Harmless when repeated."""
        await self._beside.aclose()

    def status(self) -> dict[str, Any]:
        """For a person: the newest of all robots, angles in degrees."""
        return team_status(self._state, self._names, self._clock.now_ns()) | {
            "dropped": self.dropped,
            "restarts": self.restarts,
        }

    async def _run(self) -> None:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._keep(), name="team process")
            tasks.create_task(self._tell(), name="team news")

    async def _tell(self) -> None:
        while True:
            await asyncio.sleep(_PERIOD_S)
            news = self._news(self._clock.now_ns())
            pipe = None if self._process is None else self._process.stdin
            if pipe is None or pipe.is_closing() or pipe.transport.get_write_buffer_size() > _WAITING_BYTES:
                self.dropped += 1
                continue
            pipe.write(framed(news))

    async def _keep(self) -> None:
        loop, wait_s = asyncio.get_running_loop(), _FIRST_WAIT_S
        while True:
            begun_s = loop.time()
            try:
                code = await self._serve()
                _log.warning("the team's process ended with code %d; starting another", code)
            except (OSError, ValueError, msgspec.DecodeError) as error:
                _log.warning("the team's process: %s; starting another", error)
            self.restarts += 1
            wait_s = _FIRST_WAIT_S if loop.time() - begun_s > _LASTED_S else min(2 * wait_s, _LONGEST_WAIT_S)
            await asyncio.sleep(wait_s)

    async def _serve(self) -> int:
        """One process, until it ends; its exit code."""
        process = await asyncio.create_subprocess_exec(
            *tied(sys.executable, "-m", WORKER, str(self._own), *map(str, self._names)),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=os.environ | _ONE_THREAD,
        )
        self._process = process
        try:
            assert process.stdout is not None
            while True:
                (length,) = LENGTH.unpack(await process.stdout.readexactly(LENGTH.size))
                if length > MAX_BYTES:
                    raise ValueError(f"announced {length} bytes")
                self._take(msgspec.msgpack.decode(await process.stdout.readexactly(length), type=TeamState))
        except asyncio.IncompleteReadError:
            return await process.wait()
        finally:
            self._process = None
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()

    def _take(self, state: TeamState) -> None:
        self._state = state
        self._recorder.record(TEAM, state.t_mono_ns, state)


def team_status(state: TeamState | None, names: dict[int, str], now_ns: int) -> dict[str, Any]:
    """Of the newest state; nothing of one that is old."""
    if state is None:
        return {"age_s": None, "robots": {}, "own_axes_deg": None, "own_axes_std_deg": None}
    state_age_s = age_s(state.t_mono_ns, now_ns)
    robots = {
        names[member.id]: {
            "placed": member.placed,
            "p_own_m": member.p_own_m,
            "std_m": member.std_m,
            "axes_deg": degrees(member.heading_rad),
            "axes_std_deg": degrees(member.heading_std_rad),
            "sightings": member.sightings,
        }
        for member in (state.members if state_age_s < _OLD_S else ())
    }
    return {
        "age_s": state_age_s,
        "robots": robots,
        "own_axes_deg": degrees(state.own_heading_rad),
        "own_axes_std_deg": degrees(state.own_heading_std_rad),
    }
