"""Faults of the robots' network, on a real one: an interface that is unplugged, and one that comes back as another."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from typing import Any

import pytest

from tests.paths import ROOT

_NAMESPACE = ("unshare", "--net", "--mount", "sh", "-c", 'mount -t sysfs sysfs /sys && exec "$0" "$@"')


def _unavailable() -> str:
    if os.geteuid() != 0:
        return "needs root for a network of its own"
    if shutil.which("ip") is None or shutil.which("unshare") is None:
        return "needs ip and unshare"
    made = subprocess.run(
        [*_NAMESPACE, "ip", "link", "add", "robots", "type", "veth"], capture_output=True, text=True, check=False
    )
    return f"no network of its own here: {made.stderr.strip()}" if made.returncode else ""


@pytest.fixture(scope="module")
def namespace() -> tuple[str, ...]:
    if why := _unavailable():
        pytest.skip(why)
    return _NAMESPACE


@pytest.mark.parametrize("kind", ["broadcast", "multicast", "route"])
def test_a_network_that_was_taken_away_is_found_again(kind: str, namespace: tuple[str, ...]) -> None:
    command = [*namespace, sys.executable, "-m", "tests.faults.link_process", kind]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    told: dict[str, Any] = json.loads(done.stdout)
    assert told["whole"] == {"sent": 10, "heard": 10, "problem": "", "unsent": 0}
    for number in range(3):
        gone = told[f"gone {number}"]
        assert gone["heard"] == 0
        assert gone["problem"]
        assert gone["unsent"] == 10 * (number + 1), "what did not leave is not counted as sent"
    assert told["back 2"]["sent"] == 10
    assert told["back 2"]["heard"] == 10
    assert told["back 2"]["problem"] == ""
    # One line each when it goes and when it comes, of each of the two ends.
    assert len(told["lines"]) == 4
    assert [line.startswith("the robots' network") for line in told["lines"]] == [True] * 4
