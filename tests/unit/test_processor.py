"""What a test took of the processor is told, its own and its children's apart, waiting not counted."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.paths import ROOT

_MODULE = """
import subprocess, sys, time
BURN = "import time\\nwhile time.process_time() < 0.3: pass"
def test_own():
    until = time.process_time() + 0.3
    while time.process_time() < until: pass
def test_childs():
    subprocess.run([sys.executable, "-S", "-c", BURN], check=True)
def test_waits():
    time.sleep(0.3)
"""


def test_own_and_childrens_are_told_apart_and_waiting_is_not_counted(tmp_path: Path) -> None:
    (tmp_path / "test_it.py").write_text(_MODULE)
    command = [sys.executable, "-m", "pytest", "-q", "-c", "/dev/null", "--rootdir", str(tmp_path)]
    command += ["-p", "tests.processor", "--processor", "9", "-n", "1", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    lines = [line.split() for line in done.stdout.splitlines() if "::" in line]
    taken = {words[2].partition("::")[2]: (float(words[0]), float(words[1])) for words in lines}
    assert taken["test_own"][0] >= 0.3 and taken["test_own"][1] == 0.0
    assert taken["test_childs"][1] >= 0.3 > taken["test_childs"][0]
    assert sum(taken["test_waits"]) < 0.2
