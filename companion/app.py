"""The service: one role in one TaskGroup, until a signal. A task that dies stops it, loudly."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import NoReturn

from companion.config.schema import Config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.host.ending import Ending, Parts, Stopped, cause
from companion.host.notify import notify
from companion.log.lines import record_lines
from companion.log.recorder import McapRecorder
from companion.roles.beacon_service import serve_beacon
from companion.roles.uav_service import serve_uav

_log = logging.getLogger(__name__)


def run_service(config: Config, beside: Callable[[], None] = lambda: None) -> NoReturn:
    """Serves until SIGTERM, SIGINT or SIGHUP, and ends the process: 0, or 1 or 2 with one line that says why.

    `beside` is called on the event loop before anything is opened; for tests."""
    ending = Ending()
    ending.watch_signals()
    asyncio.run(_serve_and_leave(config, ending, beside))
    raise AssertionError("the process has ended")


async def _serve_and_leave(config: Config, ending: Ending, beside: Callable[[], None]) -> NoReturn:
    """Leaves from within the loop: to close it would wait for threads that a library may hold for ever."""
    failure: BaseException | None = None
    try:
        beside()
        await _serve(config, ending)
    except BaseException as error:  # noqa: BLE001 - the process ends here, with whatever it was
        failure = error
    ending.leave(failure)


async def _serve(config: Config, ending: Ending) -> None:
    """Raises CompanionError when a part cannot start or dies."""
    ending.limit_start()
    clock = EventClock(MonotonicClock())
    recorder = McapRecorder(config.path(config.recorder.path), config, clock)
    lines = record_lines(recorder)
    role = serve_uav if config.role == "uav" else serve_beacon
    failure: BaseException | None = None
    try:
        async with Parts(ending.begin) as parts:
            parts.create_task(_until_asked(ending), name="signals")
            parts.create_task(role(config, clock, recorder, ending), name=config.role)
    except BaseExceptionGroup as group:  # no except*: Python 3.11.2 puts what is raised there into a group again
        failure = cause(group)
    finally:
        notify("STOPPING=1")
        logging.getLogger().removeHandler(lines)
        await asyncio.to_thread(recorder.close)
    if isinstance(failure, Stopped):
        _log.info("stopped on request")
    elif failure is not None:
        raise failure


async def _until_asked(ending: Ending) -> None:
    await ending.asked()
    raise Stopped
