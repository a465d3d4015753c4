"""A Ctrl-C ends who started the processes, and these with it; only the one says something."""

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


@pytest.mark.parametrize("method", ["spawn", "fork"])
def test_a_ctrl_c_ends_all_at_once(tmp_path: Path, method: str) -> None:
    script = tmp_path / "work.py"
    script.write_text(_WORK.format(method=method))
    started = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert started.stdout is not None
    assert [started.stdout.readline() for _ in range(2)] == ["begun\n"] * 2
    os.killpg(started.pid, signal.SIGINT)
    out, err = started.communicate(timeout=20)
    assert (started.returncode, out, err) == (0, "interrupted\n", "")


def test_results_belong_to_their_tasks() -> None:
    with computed(abs, [-1, -2, -3], 2) as futures:
        assert {futures[future]: future.result() for future in as_completed(futures)} == {-1: 1, -2: 2, -3: 3}
