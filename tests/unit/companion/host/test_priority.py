"""Priority over other work: what is set, what children get, and that a loop that runs away loses it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

_PRELUDE = """
import os, subprocess, sys, threading, time
from companion.host.priority import raise_priority, raise_threads, stand_back
"""
_POLICY = "print(os.sched_getscheduler({tid}) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam({tid}).sched_priority)\n"


def _run(script: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", _PRELUDE + script]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


@pytest.fixture
def permitted() -> None:
    if _run("sys.exit(bool(raise_priority()))").returncode:
        pytest.skip("real-time priority is not permitted here")


@pytest.mark.usefixtures("permitted")
def test_the_loop_comes_first_then_its_threads_and_children_get_nothing() -> None:
    child = "subprocess.run([sys.executable, '-c', 'import os;' + policy.format(tid=0)])\n"
    done = _run(
        "assert raise_priority() == ''\n"
        "thread = threading.Thread(target=time.sleep, args=(2,)); thread.start()\n"
        f"policy = {_POLICY!r}\n"
        + _POLICY.format(tid="thread.native_id")
        + "raise_threads()\n"
        + _POLICY.format(tid=0)
        + _POLICY.format(tid="thread.native_id")
        + "sys.stdout.flush()\n"
        + child
    )
    assert done.stdout.split("\n")[:4] == ["0 0", "2 10", "2 9", "0 0"], done.stderr


@pytest.mark.usefixtures("permitted")
def test_a_loop_that_runs_away_loses_its_priority() -> None:
    done = _run(
        "raise_priority()\nend_s = time.process_time() + 20\n"
        "while os.sched_getscheduler(0) != os.SCHED_OTHER and time.process_time() < end_s: pass\n"
        "print(time.process_time() < 3)"
    )
    assert done.stdout == "True\n", done.stderr


def test_without_permission_it_says_so_and_goes_on() -> None:
    if os.getuid() != 0:
        pytest.skip("only root can take what it may do away from a child")
    done = _run(
        "import resource\nfor kind in (resource.RLIMIT_RTPRIO, 13): resource.setrlimit(kind, (0, 0))\n"
        "os.setuid(65534)\nprint(raise_priority())"
    )
    assert "LimitRTPRIO=10 permits it" in done.stdout, done.stderr


def test_what_only_computes_leaves_a_core_to_a_loop_without_real_time() -> None:
    done = _run("stand_back(10)\nprint(os.nice(0) >= 10, len(os.sched_getaffinity(0)))")
    left = max(1, len(os.sched_getaffinity(0)) - 1)
    assert done.stdout.split() == ["True", str(left)]
