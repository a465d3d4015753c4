"""What a service costs that waits, all its inputs live; and how long it takes to start and to stop.

Card, camera and autopilot are simulated, the other robot is real. Memory is counted so that nothing is left out and
nothing twice: what is anonymous of each process, and of each file (a library, the interpreter) the largest part that
one of the processes holds. The kernel's own proportional size would divide the libraries among all that run here, the
simulated hardware and the other robot too, which no vehicle has.

A service that waits is woken again and again, and what that costs is the machine's: where others run in between, caches
are theirs each time. So wakes are counted, which no load changes much, and the time of an empty one is measured.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from companion.config.file import save_config
from companion.errors import CompanionError
from companion.host.control_socket import ask
from companion.host.unix_datagram import bind_datagram_socket
from companion.log.reader import LogScan
from companion.sim.stage import Cast, Stage, set_stage

_SEED: Final = 5
_READY_S: Final = 120.0
"""A first start compiles the AOA kernel."""
_SETTLED_S: Final = 3.0
_SENDER: Final = """
import socket, time
out, due = socket.socket(fileno=0), time.monotonic()
while True:
    due += 1 / 350
    time.sleep(max(0.0, due - time.monotonic()))
    out.send(bytes(200))
"""
_NAMES: Final = {"companion run": "service", "companion.sensing.worker": "worker", "companion.page.server": "page"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessCost:
    """One process of the service: what of it is resident, and its share of one core."""

    name: str
    resident_mb: float
    share: float
    wakes_per_s: float
    """Times that one of its threads had waited and went on."""
    loop_wakes_per_s: float
    """Of its first thread, in which the event loop runs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdleCost:
    """Over `seconds`. `memory_mb` and `share` are of all processes but the AOA worker."""

    seconds: float
    processes: tuple[ProcessCost, ...]
    memory_mb: float
    share: float
    csi_per_s: float
    poses_per_s: float
    start_s: float
    """From the start of the program until it says READY=1; what is compiled was kept from an earlier start."""
    start_processor_s: float
    stop_s: float
    """From SIGTERM until the process has ended."""
    log_is_whole: bool
    """Index and footer are there."""
    empty_wake_us: float
    """Processor time of an event loop that takes a datagram and does nothing, 350 times a second; just before."""


def idle_cost(seconds: float = 20.0) -> IdleCost:
    """Starts the whole cast, and its service twice: the first time fills the caches."""
    return asyncio.run(_measure(seconds))


async def _measure(seconds: float) -> IdleCost:
    empty_wake_us = await _empty_wake_us()
    with tempfile.TemporaryDirectory(prefix="companion-") as name:
        directory = Path(name)
        stage = _with_page(set_stage(directory, directory, _SEED, use_netlink=False))
        with bind_datagram_socket(directory / "notify.sock") as manager, _told(directory / "notify.sock"):
            async with Cast(stage, directory) as cast:
                await _until_live(stage)
                await _stop(cast)
                begun_s = time.monotonic()
                await cast.start_uav()
                pid = cast.pid("uav")
                await _until_ready(manager)
                start_s, start_processor_s = time.monotonic() - begun_s, _processor_s(pid)
                await _until_live(stage)
                family = {one: _name(one) for one in _family(pid)}
                before, used_s = await _health(stage), {one: _processor_s(one) for one in family}
                woken = {one: _wakes(one) for one in family}
                await asyncio.sleep(seconds)
                costs = tuple(
                    ProcessCost(
                        name=family[one],
                        resident_mb=sum(_resident(one).values()) / 1e6,
                        share=(_processor_s(one) - used_s[one]) / seconds,
                        wakes_per_s=(_wakes(one) - woken[one]).total() / seconds,
                        loop_wakes_per_s=(_wakes(one) - woken[one])[one] / seconds,
                    )
                    for one in family
                )
                after = await _health(stage)
                memory_mb = _memory_mb(one for one in family if family[one] != "worker")
                stop_s = await _stop(cast)
        wholes = list(_wholes(directory))
    span_s = (after["t_mono_ns"] - before["t_mono_ns"]) / 1e9
    return IdleCost(
        seconds=seconds,
        processes=costs,
        memory_mb=memory_mb,
        share=sum(one.share for one in costs if one.name != "worker"),
        csi_per_s=(after["radio"]["records"] - before["radio"]["records"]) / span_s,
        poses_per_s=(after["poses"]["received"] - before["poses"]["received"]) / span_s,
        start_s=start_s,
        start_processor_s=start_processor_s,
        stop_s=stop_s,
        log_is_whole=wholes == [True, True],
        empty_wake_us=empty_wake_us,
    )


async def _empty_wake_us(seconds: float = 5.0) -> float:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    ours.setblocking(False)
    count, loop = 0, asyncio.get_running_loop()

    def take() -> None:
        nonlocal count
        ours.recv(256)
        count += 1

    sender = await asyncio.create_subprocess_exec(sys.executable, "-c", _SENDER, stdin=theirs.fileno())
    theirs.close()
    loop.add_reader(ours, take)
    try:
        await asyncio.sleep(1.0)  # it has begun
        first, used_s = count, time.process_time()
        await asyncio.sleep(seconds)
        return 1e6 * (time.process_time() - used_s) / (count - first)
    finally:
        loop.remove_reader(ours)
        sender.kill()
        await sender.wait()
        ours.close()


def _wholes(directory: Path) -> Iterator[bool]:
    """Of the log of each start."""
    for path in directory.glob("log*.mcap"):
        scan = LogScan(path)
        yield sum(1 for _ in scan) > 0 and scan.is_whole


def _with_page(stage: Stage) -> Stage:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        page = replace(stage.uav.page, enabled=True, port=probe.getsockname()[1])
    uav = replace(stage.uav, page=page)
    save_config(uav, stage.directory / f"{uav.name}.yaml")
    return replace(stage, uav=uav)


@contextmanager
def _told(address: Path) -> Iterator[None]:
    """What is started in it tells us when it is ready, as it would tell systemd."""
    os.environ["NOTIFY_SOCKET"] = str(address)
    try:
        yield
    finally:
        del os.environ["NOTIFY_SOCKET"]


async def _until_ready(manager: socket.socket) -> None:
    with suppress(BlockingIOError):
        while manager.recv(256):
            pass
    async with asyncio.timeout(_READY_S):
        while await asyncio.get_running_loop().sock_recv(manager, 256) != b"READY=1":
            pass


async def _until_live(stage: Stage) -> None:
    """Card, camera, autopilot and the other robot are heard, and the worker waits."""
    async with asyncio.timeout(_READY_S):
        while True:
            with suppress(CompanionError):  # not listening yet
                if not (await ask(stage.control_socket, "status"))["not_ready"]:
                    await asyncio.sleep(_SETTLED_S)
                    return
            await asyncio.sleep(0.1)


async def _health(stage: Stage) -> dict[str, Any]:
    health = (await ask(stage.control_socket, "status"))["health"]
    assert isinstance(health, dict)
    return health


async def _stop(cast: Cast) -> float:
    begun_s = time.monotonic()
    os.kill(cast.pid("uav"), signal.SIGTERM)
    await cast.wait("uav")
    return time.monotonic() - begun_s


def _family(pid: int) -> Iterator[int]:
    """The process and all below it."""
    yield pid
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            yield from _family(int(child))


def _name(pid: int) -> str:
    command = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return next((name for words, name in _NAMES.items() if words in command), command)


def _resident(pid: int) -> Counter[str]:
    """Bytes by file, what is anonymous under the empty name."""
    sizes: Counter[str] = Counter()
    file, resident = "", 0
    for line in Path(f"/proc/{pid}/smaps").read_text().splitlines():
        head, *fields = line.split()
        if not head.endswith(":"):
            file = " ".join(fields[4:])
        elif head == "Rss:":
            resident = int(fields[0]) << 10
        elif head == "Anonymous:":
            anonymous = int(fields[0]) << 10
            sizes[""] += anonymous
            sizes[file] += resident - anonymous
    return sizes


def _memory_mb(pids: Iterable[int]) -> float:
    anonymous, files = 0, Counter[str]()
    for pid in pids:
        sizes = _resident(pid)
        anonymous += sizes.pop("")
        files |= sizes  # the larger of the two
    return (anonymous + files.total()) / 1e6


def _wakes(pid: int) -> Counter[int]:
    """By thread, so far; the first thread has the number of the process."""
    found: Counter[int] = Counter()
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError):  # it has ended
            line = next(one for one in (task / "status").read_text().splitlines() if one.startswith("voluntary"))
            found[int(task.name)] = int(line.split()[1])
    return found


def _processor_s(pid: int) -> float:
    """User and system time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
