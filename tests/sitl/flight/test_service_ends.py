"""The service ends in flight: a part of it fails, it is killed, its watchdog is not fed."""

from __future__ import annotations

import asyncio
import socket
import time
from contextlib import suppress
from pathlib import Path

import pytest

from companion.core.clock import NS_PER_S
from companion.host.unix_datagram import bind_datagram_socket
from tests.faults.campaigns import runs
from tests.faults.figures import record
from tests.sitl.flying import Flying

pytestmark = pytest.mark.asyncio(loop_scope="package")


@pytest.mark.parametrize(
    "task", ["flight"] if runs(0, 1) == 0 else
    ["flight", "health", "node", "poses", "broadcast", "aoa", "control", "autopilot", "watchdog", "pose reader"],
)  # fmt: skip
async def test_fault_04_a_part_that_fails_leaves_the_vehicle_in_hold(flying: Flying, task: str) -> None:
    await flying.fly()
    await asyncio.sleep(0.5)
    raised_ns = time.monotonic_ns()
    flying.fault(f"raise {task}")
    code = await asyncio.wait_for(flying.cast.wait("uav"), 10.0)
    report = await flying.px4()
    began_ns, mode = report.history[-1]
    took_s = (began_ns - raised_ns) / NS_PER_S
    record(4, hold_after_s=round(took_s, 2), exit_code=code)
    assert mode == "HOLD" and not report.failsafe and took_s <= 0.5
    assert code == 1
    assert f"a test made task {task} fail" in (flying.out / "uav.txt").read_text()
    await flying.restart()
    assert (await flying.status())["state"] == "idle"


def _lives(pid: int) -> bool:
    """Whether it runs. A dead child that nobody has collected yet does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in ("Z", "X")
    except OSError:
        return False


@pytest.mark.parametrize("part", range(runs(1, 5)))
async def test_fault_02_a_killed_service_is_silent_and_leaves_nothing_behind(flying: Flying, part: int) -> None:
    last_s, orphans, count = -1.0, 0, runs(1, 20)
    for _ in range(count):
        await flying.fly()
        await asyncio.sleep(0.3)
        children = [pid for module in ("companion.sensing.worker", "pose_relay") for pid in flying.children(module)]
        killed_ns = await flying.kill()
        await asyncio.sleep(1.3)
        report = await flying.px4()
        assert report.last_setpoint_mono_ns is not None
        last_s = max(last_s, (report.last_setpoint_mono_ns - killed_ns) / NS_PER_S)
        orphans += sum(_lives(pid) for pid in children)
        assert len(children) == 2 and report.mode == "HOLD"
    record(2, runs=count, last_set_point_after_s=round(last_s, 3), orphans=orphans)
    assert last_s <= 0.2 and orphans == 0


async def test_fault_27_an_unfed_watchdog_means_killed_and_idle(
    flying: Flying, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The test is the service manager: it kills what has not fed the watchdog for WatchdogSec (3 s), and restarts."""
    if not flying.has_ended:
        await flying.kill()
    loop = asyncio.get_running_loop()
    with bind_datagram_socket(tmp_path / "notify.sock") as manager:
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify.sock"))
        await flying.restart()
        assert await asyncio.wait_for(loop.sock_recv(manager, 256), 10.0) == b"READY=1"
        await flying.fly()
        with suppress(BlockingIOError):
            while manager.recv(256, socket.MSG_DONTWAIT):
                pass
        assert await asyncio.wait_for(loop.sock_recv(manager, 256), 3.0) == b"WATCHDOG=1"
        flying.fault("block 20")
        since_s = time.monotonic()
        while True:
            try:
                await asyncio.wait_for(loop.sock_recv(manager, 256), 3.0)
            except TimeoutError:
                break
        unfed_s = time.monotonic() - since_s
        await flying.kill()
        monkeypatch.delenv("NOTIFY_SOCKET")
    killed = await flying.px4()
    await flying.restart()
    await asyncio.sleep(2.0)
    after = await flying.px4()
    record(27, killed_after_s=round(unfed_s, 1), offboard_afterwards=after.mode == "OFFBOARD")
    assert (await flying.status())["state"] == "idle"
    assert killed.mode == after.mode == "HOLD" and after.setpoints == killed.setpoints
