"""How the service's process ends: with its reason, in bounded time, whatever hangs.

A signal is seen by a thread of its own, since the event loop may stand still in foreign code. From the moment the
ending begins two clocks run: a thread that says what happened and leaves, and behind it one of faulthandler's, in C,
which needs no part of the interpreter. The process leaves by `os._exit`: destructors of native libraries are not asked.
"""

from __future__ import annotations

import asyncio
import contextlib
import faulthandler
import os
import signal
import sys
import threading
from collections.abc import Callable, Coroutine, Generator
from contextvars import Context
from typing import Any, Final, NoReturn, TypeVar

from companion.errors import CompanionError

END_LIMIT_S: Final = 8.0
"""From the beginning of the end until the process is gone; below TimeoutStopSec of systemd/companion.service."""
START_LIMIT_S: Final = 20.0
"""For opening all that must be open; nothing of it waits for another machine."""
_BEHIND_S: Final = 1.0
_T = TypeVar("_T")
_SIGNALS: Final = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


class Stopped(Exception):
    """Somebody asked the service to end."""


class Ending:
    """One for a process, made on its main thread."""

    def __init__(self, limit_s: float = END_LIMIT_S) -> None:
        self._limit_s = limit_s
        self._lock = threading.Lock()
        self._clock: threading.Timer | None = None
        self._told: CompanionError | None = None
        self._begun = False
        self._asked = threading.Event()
        self._on_asked: Callable[[], object] = lambda: None
        self._nothing = os.open(os.devnull, os.O_WRONLY)

    def watch_signals(self) -> None:
        """SIGTERM, SIGINT and SIGHUP end the service from now on."""
        readable, writable = os.pipe()
        os.set_blocking(writable, False)
        # No handler of the event loop: it would be run by the loop, and the loop may stand still.
        for number in _SIGNALS:
            signal.signal(number, lambda number, frame: None)
        signal.set_wakeup_fd(writable, warn_on_full_buffer=False)
        threading.Thread(target=self._read_signals, args=(readable,), name="signals", daemon=True).start()

    async def asked(self) -> None:
        """Until a signal asks for the end."""
        loop, event = asyncio.get_running_loop(), asyncio.Event()
        self._on_asked = lambda: loop.call_soon_threadsafe(event.set)
        if not self._asked.is_set():
            await event.wait()

    def limit_start(self) -> None:
        """From now until `started` the start has its own limit."""
        self._arm(START_LIMIT_S, "not everything could be opened")

    def started(self) -> None:
        with self._lock:
            if not self._begun:
                self._disarm()

    def begin(self, why: BaseException | str) -> None:
        """The end has begun. What a person can act on is said now, not only when everything has been closed."""
        with self._lock:
            is_first, self._begun = not self._begun, True
        if isinstance(why, CompanionError) and self._told is None:
            self._told = why
            say(str(why))
        if is_first:
            self._arm(self._limit_s, f"{why}: not ended")

    def leave(self, failure: BaseException | None) -> NoReturn:
        """Says what was not said yet, and ends the process: 0, or the failure's exit code."""
        if failure is None:
            _leave(0)
        if isinstance(failure, CompanionError):
            if self._told is None:
                say(str(failure))
            _leave((self._told or failure).exit_code)
        sys.excepthook(type(failure), failure, failure.__traceback__)
        _leave(1)

    def _read_signals(self, readable: int) -> None:
        while numbers := os.read(readable, 64):
            for number in numbers:
                if number in _SIGNALS:
                    self.begin(signal.Signals(number).name)
                    self._asked.set()
                    with contextlib.suppress(RuntimeError):  # the loop is gone
                        self._on_asked()

    def _arm(self, limit_s: float, what: str) -> None:
        with self._lock:
            self._disarm()
            text = f"{what} within {limit_s:g} s; left without closing everything"
            self._clock = threading.Timer(limit_s, self._give_up, (text,))
            self._clock.daemon = True
            self._clock.start()
            faulthandler.dump_traceback_later(limit_s + _BEHIND_S, exit=True, file=self._nothing)

    def _disarm(self) -> None:
        if self._clock is not None:
            self._clock.cancel()
        self._clock = None
        faulthandler.cancel_dump_traceback_later()

    def _give_up(self, text: str) -> None:
        if self._told is not None:  # its reason has been said
            _leave(self._told.exit_code)
        say(text)
        _leave(1)


class Parts(asyncio.TaskGroup):
    """Tells `begin` of a task's failure at once, not when the other tasks have ended too: one of them may never."""

    def __init__(self, begin: Callable[[BaseException], None]) -> None:
        super().__init__()
        self._begin = begin

    def create_task(
        self,
        coro: Generator[Any, None, _T] | Coroutine[Any, Any, _T],
        *,
        name: str | None = None,
        context: Context | None = None,
    ) -> asyncio.Task[_T]:
        task = super().create_task(coro, name=name, context=context)
        task.add_done_callback(self._see)
        return task

    def _see(self, task: asyncio.Task[Any]) -> None:
        if not task.cancelled() and (error := task.exception()) is not None:
            self._begin(cause(error))


def cause(error: BaseException) -> BaseException:
    """What to tell of a group of failures: the first that nobody has foreseen, else the first that is no wish."""
    if not isinstance(error, BaseExceptionGroup):
        return error
    return min((cause(inner) for inner in error.exceptions), key=_rank)


def _rank(error: BaseException) -> int:
    return 2 if isinstance(error, Stopped) else 1 if isinstance(error, CompanionError) else 0


def say(text: str) -> None:
    """One line on standard error. A closed one must not change how the process ends."""
    with contextlib.suppress(OSError, ValueError):
        print(f"companion: {text}", file=sys.stderr, flush=True)


def _leave(code: int) -> NoReturn:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)
