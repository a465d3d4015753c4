"""The robots' network taken away and given back, in a network namespace of its own; prints what the link said.

python -m tests.faults.link_process broadcast|multicast|route
"""

from __future__ import annotations

import asyncio
import json
import logging
import subprocess
import sys
import time
from dataclasses import replace
from typing import Any

from companion.config.file import load_config
from companion.core.clock import NS_PER_S
from companion.host.coalescing import CoalescedReaders
from companion.neighbours.link import Link
from tests.paths import CONFIGS

_LONGEST_S = 5.0
"""So long is waited for what is to arrive: the kernel tells only once a second that an interface carries again."""
_TO = {"broadcast": "10.77.0.255", "multicast": "239.1.2.3", "route": "10.77.0.255"}


class _Lines(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())


def _plug_in() -> None:
    for command in (
        "link set lo up",
        "link add robots type veth peer name far",
        "addr add 10.77.0.1/24 brd + dev robots",
        "link set robots up",
        "link set far up",
    ):
        subprocess.run(["ip", *command.split()], check=True)


def _unplug() -> None:
    subprocess.run(["ip", "link", "del", "robots"], check=True)


async def _run(kind: str) -> dict[str, Any]:
    lines = _Lines()
    logging.getLogger("companion.neighbours.link").addHandler(lines)
    _plug_in()
    config = load_config(CONFIGS / "demo-uav.yaml")
    interface = None if kind == "route" else "robots"
    config = replace(config, neighbours=replace(config.neighbours, broadcast=_TO[kind], interface=interface))
    ours, theirs = Link(config), Link(config)
    heard: list[bytes] = []

    def hear() -> int:
        arrived = theirs.drain()
        heard.extend(arrived)
        return len(arrived)

    theirs.attach(CoalescedReaders(asyncio.get_running_loop()), hear)
    seconds = 0
    result: dict[str, Any] = {}

    async def second(name: str) -> None:
        """One second as the service counts them."""
        nonlocal seconds
        seconds += 1
        heard.clear()
        sent = sum(ours.send(b"%d" % number) for number in range(10))
        theirs.send(b"own")
        ours.watch(seconds * NS_PER_S)
        theirs.watch(seconds * NS_PER_S)
        await asyncio.sleep(0.02)
        others = [data for data in heard if data != b"own"]
        result[name] = {"sent": sent, "heard": len(others), "problem": ours.problem, "unsent": ours.unsent}

    await second("whole")
    _unplug()
    for number in range(3):
        await second(f"gone {number}")
    _plug_in()
    for number in range(3):
        await second(f"back {number}")
    deadline_s = time.monotonic() + _LONGEST_S
    while result["back 2"]["heard"] != 10 and time.monotonic() < deadline_s:
        await asyncio.sleep(0.1)
        await second("back 2")
    result["lines"] = lines.texts
    ours.close()
    theirs.close()
    return result


if __name__ == "__main__":
    print(json.dumps(asyncio.run(_run(sys.argv[1]))))
