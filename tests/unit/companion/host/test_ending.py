"""The end of a process: its reason is said when it begins, and it comes, whatever hangs."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from companion.errors import CompanionError, ConfigError
from companion.host.ending import Stopped, cause
from tests.child import child

_STUCK = """
import asyncio, ctypes, sys, threading, time
from companion.errors import CompanionError
from companion.host.ending import Ending, Parts

{how}

async def fail():
    await asyncio.sleep(0.01)
    raise CompanionError("the disk is gone")

async def hang():
    await asyncio.sleep(0)
    try:
        await asyncio.get_running_loop().create_future()
    finally:
        stick()

async def main(ending):
    async with Parts(ending.begin) as parts:
        parts.create_task(hang())
        if "fail" in sys.argv:
            parts.create_task(fail())
        else:
            print("up", flush=True)
            parts.create_task(ending.asked())
            await asyncio.sleep(0.1)
            stick()

ending = Ending(limit_s=1.0)
ending.watch_signals()
asyncio.run(main(ending))
"""
_IN_FOREIGN_CODE = "stick = lambda: time.sleep(60)"
_WITH_THE_LOCK = "stick = lambda: ctypes.PyDLL(None).sleep(60)"  # neither threads nor handlers of Python run


@pytest.mark.parametrize("how", [_IN_FOREIGN_CODE, _WITH_THE_LOCK], ids=["foreign code", "interpreter held"])
def test_a_failure_is_told_at_once_and_a_part_that_hangs_does_not_keep_the_process(how: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _STUCK.format(how=how), "fail"], capture_output=True, text=True, timeout=50, check=False
    )
    assert (done.returncode, done.stderr) == (1, "companion: the disk is gone\n")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_a_process_whose_loop_stands_still(number: signal.Signals) -> None:
    command = [sys.executable, "-c", _STUCK.format(how=_IN_FOREIGN_CODE)]
    with child(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "up\n"
        time.sleep(0.3)  # into the call that does not return
        process.send_signal(number)
        assert process.wait(40) == 1
        assert process.stderr.read() == (
            f"companion: {number.name}: not ended within 1 s; left without closing everything\n"
        )


def test_of_several_failures_the_one_nobody_foresaw_is_told() -> None:
    bug, fault, wish = KeyError("x"), CompanionError("no disk"), Stopped()
    assert cause(BaseExceptionGroup("", [wish, ExceptionGroup("", [fault, bug])])) is bug
    assert cause(ExceptionGroup("", [wish, fault, ConfigError("later")])) is fault
    assert cause(wish) is wish
