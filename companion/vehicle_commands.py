"""The one command to the autopilot that runs beside the control loop; its outcome is an input of the mission."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from types import TracebackType
from typing import Any, Protocol

from companion.autopilot.port import AutopilotError

Report = Callable[[AutopilotError | None], None]


class Commands(Protocol):
    """Runs at most one command at a time, as an async context that outlives it."""

    def start(self, command: Coroutine[Any, Any, None], report: Report) -> None:
        """Begins `command` in place of an older one. `report` hears how it ended, unless it was cancelled."""

    def cancel(self) -> None:
        """Ends the command that runs, if any, without a report."""

    async def __aenter__(self) -> Commands: ...

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> bool | None: ...


class CommandTask:
    """Commands as tasks of the event loop. What is no AutopilotError ends the context, as in any task group."""

    def __init__(self) -> None:
        self._group = asyncio.TaskGroup()
        self._task: asyncio.Task[None] | None = None

    def start(self, command: Coroutine[Any, Any, None], report: Report) -> None:
        self.cancel()
        self._task = self._group.create_task(_reported(command, report), name="command")

    def cancel(self) -> None:
        if self._task is not None:
            self._task.cancel()
            self._task = None

    async def __aenter__(self) -> CommandTask:
        await self._group.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        await self._group.__aexit__(kind, error, traceback)


async def _reported(command: Coroutine[Any, Any, None], report: Report) -> None:
    try:
        await command
    except AutopilotError as error:
        report(error)
    else:
        report(None)
