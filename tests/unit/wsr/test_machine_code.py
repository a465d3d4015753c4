"""Cached machine code is used while all that it is made of is as it was, and no longer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

_SOURCES = {
    "helper.py": "from wsr.machine_code import inner\n\n@inner\ndef helper(x):\n    return 2.0 * x\n",
    "constant.py": "OFFSET = 1.0\n",
    "caller.py": (
        "from constant import OFFSET\nfrom helper import helper\nfrom wsr.machine_code import compiled\n\n"
        "@compiled\ndef caller(x):\n    return helper(x) + OFFSET\n"
    ),
}
_PROGRAM = "from caller import caller; print(caller(1.0), sum(caller.stats.cache_hits.values()))"


def _run(folder: Path) -> tuple[float, bool]:
    """What `caller(1.0)` gives in a new process, and whether its machine code was read."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": str(folder)}
    command = [sys.executable, "-c", _PROGRAM]
    out = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
    value, hits = out.split()
    return float(value), hits == "1"


def test_what_a_function_calls_in_another_file_is_not_left_as_it_was(tmp_path: Path) -> None:
    """As after a pull into a checkout that has flown: the caller's file is the same, its helper's is not."""
    for name, text in _SOURCES.items():
        (tmp_path / name).write_text(text)
    assert _run(tmp_path) == (3.0, False)
    assert _run(tmp_path) == (3.0, True)
    (tmp_path / "helper.py").write_text(_SOURCES["helper.py"].replace("2.0", "5.0"))
    assert _run(tmp_path) == (6.0, False)
    (tmp_path / "constant.py").write_text("OFFSET = 10.0\n")
    assert _run(tmp_path) == (15.0, False)
