"""The service: one role in one TaskGroup, until a signal. A task that dies stops it, loudly."""

from __future__ import annotations

import asyncio
import logging
import signal
from typing import Any

from companion.config.schema import Config
from companion.core.clock import MonotonicClock
from companion.core.event_clock import EventClock
from companion.errors import CompanionError
from companion.host.notify import notify
from companion.log.lines import record_lines
from companion.log.recorder import McapRecorder
from companion.roles.beacon_service import serve_beacon
from companion.roles.uav_service import serve_uav

_log = logging.getLogger(__name__)


class _Stopped(Exception):
    """Somebody asked the service to end."""


async def serve(config: Config) -> None:
    """Runs until SIGTERM or SIGINT. Raises CompanionError when a part cannot start or dies."""
    clock = EventClock(MonotonicClock())
    recorder = McapRecorder(config.path(config.recorder.path), config, clock)
    role = serve_uav if config.role == "uav" else serve_beacon
    lines = record_lines(recorder)
    try:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(_until_signal(), name="signals")
            tasks.create_task(role(config, clock, recorder), name=config.role)
    except* _Stopped:
        _log.info("stopped on request")
    except* CompanionError as group:
        raise _first(group) from None
    finally:
        notify("STOPPING=1")
        logging.getLogger().removeHandler(lines)
        await asyncio.to_thread(recorder.close)


async def _until_signal() -> None:
    asked = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, asked.set)
    await asked.wait()
    raise _Stopped


def _first(group: BaseExceptionGroup[Any]) -> CompanionError:
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    assert isinstance(error, CompanionError)
    return error
