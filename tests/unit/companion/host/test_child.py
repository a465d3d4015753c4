"""Children that do not outlive who started them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from companion.host.child import tied


def test_the_command_is_run_and_its_exit_is_the_childs() -> None:
    done = subprocess.run(tied("sh", "-c", "echo $PPID; exit 7"), capture_output=True, text=True, check=False)
    assert done.returncode == 7
    assert int(done.stdout) == os.getpid(), "it takes the place of the process that was started"


def test_a_command_that_is_not_there_is_named() -> None:
    done = subprocess.run(tied("no-such-command"), capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "no-such-command: No such file or directory\n")


def test_who_is_tied_to_another_than_its_parent_runs_nothing(tmp_path: Path) -> None:
    """The parent died before the child was tied to it."""
    command = (*tied()[:3], "1", "touch", str(tmp_path / "ran"))
    assert subprocess.run(command, check=False).returncode == 1
    assert not (tmp_path / "ran").exists()


def test_the_child_dies_with_its_parent() -> None:
    parent = (
        "import subprocess, time; from companion.host.child import tied;"
        "child = subprocess.Popen(tied('sleep', '60')); print(child.pid, flush=True); time.sleep(60)"
    )
    with subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True) as started:
        assert started.stdout is not None
        child = int(started.stdout.readline())
        _until(lambda: b"sleep" in Path(f"/proc/{child}/cmdline").read_bytes())
        started.kill()
    _until(lambda: _is_gone(child))


def test_a_ctrl_c_is_for_the_parent() -> None:
    with subprocess.Popen(tied("sleep", "60")) as child:
        _until(lambda: Path(f"/proc/{child.pid}/cmdline").read_bytes().startswith(b"sleep"))
        child.send_signal(signal.SIGINT)
        child.terminate()
        assert child.wait(10) == -signal.SIGTERM


def _until(holds: object) -> None:
    assert callable(holds)
    deadline_s = time.monotonic() + 30
    while not holds():
        assert time.monotonic() < deadline_s
        time.sleep(0.01)


def _is_gone(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z"
    except OSError:
        return True
