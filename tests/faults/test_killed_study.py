"""A study that is killed leaves no process behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

_LIMIT_S = 60.0


def _children(parent: int) -> set[int]:
    text = Path(f"/proc/{parent}/task/{parent}/children").read_text()
    return {int(number) for number in text.split()}


def _lives(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.long
def test_its_workers_die_with_it(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "companion", "study", "geometry", "--trials", "400", "--jobs", "2"]
    with subprocess.Popen([*command, "--out", str(tmp_path)], stderr=subprocess.DEVNULL) as study:
        end_s = time.monotonic() + _LIMIT_S
        while len(workers := _children(study.pid)) < 3 and time.monotonic() < end_s:  # two, and what tracks them
            time.sleep(0.05)
        time.sleep(2.0)  # into their work
        os.kill(study.pid, signal.SIGKILL)
    assert len(workers) == 3
    while any(map(_lives, workers)) and time.monotonic() < end_s:
        time.sleep(0.05)
    assert not any(map(_lives, workers))
