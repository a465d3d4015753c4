"""The control loop before other work of the machine: a small real-time priority, with a bound on what it may cost."""

from __future__ import annotations

import asyncio
import os
import resource
import signal
from pathlib import Path
from typing import Final

LOOP_PRIORITY: Final = 10
"""Of the event loop's thread; LimitRTPRIO of systemd/companion.service permits it."""
_OTHERS_PRIORITY: Final = LOOP_PRIORITY - 1
"""Of the process's other threads: one that holds the interpreter's lock must not wait for strangers either."""
_NICE: Final = -10
_RUNAWAY_US: Final = 1_000_000
_THREADS: Final = Path("/proc/self/task")
_LOOK_S: Final = 1.0


def raise_priority() -> str:
    """Puts this process before others; empty, or what it must do without, in words.

    Children and threads made later do not inherit it (`keep_priority` sees to the threads). A thread that computes for
    a second without once waiting gets SIGXCPU and loses its priority; after three the kernel kills the process.
    """
    try:
        _limit_runaways()
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(LOOP_PRIORITY))
        return ""
    except OSError as error:
        why = error.strerror
    try:
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        return f"no real-time priority ({why}): nice {_NICE} instead; LimitRTPRIO={LOOP_PRIORITY} permits it"
    except OSError:
        return f"no priority over other work of this machine ({why}); LimitRTPRIO={LOOP_PRIORITY} permits it"


async def keep_priority() -> None:
    """Gives threads that libraries have made meanwhile what the loop has."""
    while True:
        raise_threads()
        await asyncio.sleep(_LOOK_S)


def raise_threads() -> None:
    """The other threads of this process, where the calling one runs in real time."""
    if not _in_real_time(0):
        return
    for tid in _threads():
        try:
            if os.sched_getscheduler(tid) == os.SCHED_OTHER:
                os.sched_setscheduler(tid, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(_OTHERS_PRIORITY))
        except ProcessLookupError:
            continue  # it has ended meanwhile


def stand_back(nice: int) -> None:
    """For a child that only computes: niced and, where the parent's loop could not get real time, off one of several
    cores. A loop in real time needs no core of its own, and to do without one costs much of a busy machine."""
    os.nice(nice)
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) > 1 and not _in_real_time(os.getppid()):
        os.sched_setaffinity(0, cores[1:])


def _limit_runaways() -> None:
    """SIGXCPU comes to the thread that runs away, and may not wait for its Python: the kernel's own bound is behind."""
    signal.signal(signal.SIGXCPU, lambda number, frame: _give_way())
    resource.setrlimit(resource.RLIMIT_RTTIME, (_RUNAWAY_US, 3 * _RUNAWAY_US))


def _give_way() -> None:
    for tid in _threads():
        os.sched_setscheduler(tid, os.SCHED_OTHER, os.sched_param(0))


def _in_real_time(pid: int) -> bool:
    return os.sched_getscheduler(pid) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR


def _threads() -> list[int]:
    return [int(entry.name) for entry in _THREADS.iterdir()]
