"""A signal ends who started the processes, and these with it; only the one says something."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from concurrent.futures import as_completed
from pathlib import Path

import pytest

from companion.host.pool import computed

_WORK = """
import os, time
from companion.host.pool import computed

def work(seconds):
    os.write(1, b"begun\\n")
    time.sleep(seconds)

if __name__ == "__main__":
    try:
        with computed(work, [60, 60, 60], 2, {method!r}) as futures:
            for future in futures:
                future.result()
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("method", ["spawn", "fork"])
@pytest.mark.parametrize("whole_group", [True, False])
def test_a_signal_ends_all_at_once_and_nothing_is_left(
    tmp_path: Path, method: str, number: signal.Signals, whole_group: bool
) -> None:
    script = tmp_path / "work.py"
    script.write_text(_WORK.format(method=method))
    started = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert started.stdout is not None
    assert [started.stdout.readline() for _ in range(2)] == ["begun\n"] * 2
    (os.killpg if whole_group else os.kill)(started.pid, number)
    out, err = started.communicate(timeout=20)
    assert (started.returncode, out, err) == (0, "interrupted\n", "")


def test_a_signal_that_was_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with computed(abs, [-1], 1) as futures:
            os.kill(os.getpid(), signal.SIGHUP)
            assert [future.result() for future in futures] == [1]
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_results_belong_to_their_tasks() -> None:
    with computed(abs, [-1, -2, -3], 2) as futures:
        assert {futures[future]: future.result() for future in as_completed(futures)} == {-1: 1, -2: 2, -3: 3}
