"""A page in headless Chromium: what it renders, what it says on its console, what it asks the network for."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

import pytest

CHROMIUM: Final = shutil.which("chromium")
_BUDGET_MS: Final = 4000


@dataclass(frozen=True)
class Visit:
    """One look at a page."""

    dom: str
    console: list[str]
    outside: list[str]
    """Hosts that were asked for anything, but this machine."""


def visit(url: str, folder: Path) -> Visit:
    """Opens `url` with a fresh profile. Skips the test where there is no Chromium."""
    if CHROMIUM is None:
        pytest.skip("no /usr/bin/chromium here (apt-get install chromium)")
    folder.mkdir(parents=True, exist_ok=True)
    requests = folder / "net.json"
    command = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        "--disable-component-update", "--disable-sync", "--no-first-run", "--disable-default-apps",
        "--enable-logging=stderr", "--v=0", f"--log-net-log={requests}", f"--user-data-dir={folder / 'profile'}",
        f"--virtual-time-budget={_BUDGET_MS}", "--dump-dom", url,
    ]  # fmt: skip
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=False, env=os.environ | {"HOME": str(folder)}
    )
    assert done.returncode == 0, done.stderr[-2000:]
    console = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    return Visit(done.stdout, console, _outside(requests, url))


def _outside(requests: Path, url: str) -> list[str]:
    """Of the requests that pages make: those of the browser itself for its own updates carry no initiator."""
    text = requests.read_text()
    try:
        events = json.loads(text)["events"]
    except json.JSONDecodeError:  # the browser was gone before it closed the list
        events = json.loads(text.rstrip().rstrip(",") + "]}")["events"]
    asked = set()
    for event in events:
        parameters = event.get("params", {})
        target = parameters.get("url", "")
        if parameters.get("initiator", "not an origin") == "not an origin" or not target.startswith(("http", "ws")):
            continue
        asked.add(urlsplit(target).hostname or "")
    return sorted(asked - {"127.0.0.1", "localhost", urlsplit(url).hostname or ""})
