"""The whole service against the mock autopilot: the flight rows of the fault table, one cast for all of them.

Each test takes the vehicle as it finds it (engaged or not, in the air or not) and leaves it to the next. FC is the mock
autopilot, which counts what it receives by the kernel's own time stamps. `make faults` runs the long counts, in parts.
Longer than other modules, since a cast takes seconds to start and serves one module.
"""

from __future__ import annotations

import asyncio
import math
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import pytest_asyncio

from companion.core.clock import NS_PER_S
from companion.host.unix_datagram import bind_datagram_socket
from tests.faults.campaigns import runs
from tests.faults.figures import record
from tests.sitl.flying import Flying
from tests.sitl.flying import flying as running

pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest_asyncio.fixture(loop_scope="module", scope="module")
async def flying(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Flying]:
    autopilot = {"engage_rc_channel": 3, "forward_vio_hz": 30.0}
    async with running(tmp_path_factory.mktemp("flight"), autopilot=autopilot) as started:
        yield started


async def _seconds_until_latched(flying: Flying, since_s: float, timeout_s: float) -> float:
    await flying.in_state("latched", timeout_s=timeout_s)
    return time.monotonic() - since_s


async def test_an_engagement_is_refused_with_the_whole_list(flying: Flying) -> None:
    await flying.until(lambda status: not status["not_ready"])
    await flying.px4("parameter COM_OBL_RC_ACT 0")
    await flying.px4("parameter GF_ACTION 4")
    await flying.px4("estimator unhealthy")
    await flying.px4("battery 0.05")
    told = ("estimator is not healthy", "battery is low")
    await flying.until(lambda status: all(any(part in line for line in status["not_ready"]) for part in told), 10.0)
    answer = await flying.command("engage")
    assert not answer["ok"]
    for part in (
        "the battery is low: 5 %, wanted 20",
        "estimator is not healthy",
        "COM_OBL_RC_ACT is 0; wanted 4 (land) or 5 (hold): what PX4 does when the stream is lost",
        "GF_ACTION is 4; wanted 2 (hold), 3 (return) or 5 (land)",
    ):
        assert part in answer["error"]
    assert not (await flying.px4("parameter COM_OBL_RC_ACT 5")).armed
    for order in ("parameter GF_ACTION 2", "estimator healthy", "battery 0.9"):
        await flying.px4(order)


@pytest.mark.parametrize("how", ["command", "switch"])
async def test_an_abort_while_an_engagement_is_still_checked_ends_it(flying: Flying, how: str) -> None:
    await flying.until(lambda status: not status["not_ready"])
    await flying.px4("rc 1500 1500 1900" if how == "switch" else "rc")
    await asyncio.sleep(0.3)
    await flying.px4("parameters silent")
    engaging = asyncio.create_task(flying.command("engage"))
    await asyncio.sleep(0.1)
    if how == "switch":
        await flying.px4("rc 1500 1500 1000")
    else:
        assert (await flying.command("abort"))["ok"]
    await asyncio.sleep(0.3)
    await flying.px4("parameters heard")  # they are asked for again
    answer = await engaging
    # On a loaded machine a line of the preflight may stand beside it.
    assert not answer["ok"] and "it was aborted meanwhile" in answer["error"].split("; ")
    await asyncio.sleep(0.2)
    report = await flying.px4("rc")
    assert not report.armed and (await flying.status())["state"] == "idle"


async def test_a_switch_that_is_up_when_rc_comes_back_engages_nothing(flying: Flying) -> None:
    await flying.until(lambda status: not status["not_ready"])
    await flying.px4("rc 1500 1500 1000")
    await asyncio.sleep(0.5)
    await flying.px4("rc")  # no receiver any more
    await asyncio.sleep(1.3)
    await flying.px4("rc 1500 1500 1900")
    await asyncio.sleep(0.7)
    assert (await flying.status())["state"] == "idle"


async def test_hold_taken_by_a_person_during_the_climb_is_theirs(flying: Flying) -> None:
    await flying.px4("rc 1500 1500 1000")
    await asyncio.sleep(0.5)
    await flying.px4("rc 1500 1500 1900")  # engaged by the switch
    await flying.until(lambda _: flying.now.vehicle.p_enu_m[2] > 0.4, 20.0)
    await flying.px4("pilot HOLD")
    status = await flying.in_state("latched", timeout_s=10.0)
    assert "somebody else decided" in status["reason"]
    await asyncio.sleep(1.0)
    report = await flying.px4("rc")
    assert report.setpoints == 0 and report.mode == "HOLD"


@pytest.mark.parametrize("how", ["refuse", "silent"])
async def test_fault_10_a_refused_or_ignored_offboard_is_given_up(flying: Flying, how: str) -> None:
    await flying.px4(f"offboard {how}")
    await flying.engage()
    await flying.until(lambda status: status["streaming"])
    since_s = time.monotonic()
    took_s = await _seconds_until_latched(flying, since_s, 8.0) - 1.0  # the stream runs for 1 s before it is asked for
    status = await flying.status()
    record(10, given_up_after_s=round(took_s, 2))
    assert took_s < 3.2  # 3 s, and how often this test looks
    assert "offboard_refused: mode offboard: not confirmed by telemetry" in status["reason"]
    assert (await flying.px4("offboard accept")).mode == "HOLD"


@pytest.mark.parametrize("part", range(runs(1, 5)))
async def test_fault_09_a_pilot_is_obeyed_and_never_overruled(flying: Flying, part: int) -> None:
    last_s, taken_back = 0.0, 0
    count = runs(2, 20)
    for number in range(count):
        await flying.fly()
        await asyncio.sleep(0.2)
        taken = await flying.px4(f"pilot {('POSCTL', 'ALTCTL', 'HOLD')[number % 3]}")
        await flying.in_state("latched", timeout_s=2.0)
        await asyncio.sleep(0.5)
        if number == 0:
            assert (await flying.command("abort"))["ok"]
            await asyncio.sleep(1.0)
            refusal = (await flying.command("engage"))["error"]
            assert "the vehicle is flown in mode manual; put it into hold first" in refusal
        after = await flying.px4()
        assert after.last_setpoint_mono_ns is not None
        last_s = max(last_s, (after.last_setpoint_mono_ns - taken.t_mono_ns) / NS_PER_S)
        taken_back += after.mode != taken.mode
    record(9, runs=count, last_set_point_after_s=round(last_s, 3), taken_back=taken_back)
    assert last_s <= 0.2 and taken_back == 0


async def test_fault_08_silent_heartbeats_lose_the_link(flying: Flying) -> None:
    figures: dict[str, float] = {}
    for what in ("everything", "heartbeats"):
        await flying.fly()
        await flying.px4(f"mute {what}")
        since_s = time.monotonic()
        took_s = await _seconds_until_latched(flying, since_s, 5.0)
        status = await flying.status()
        sent = await flying.px4("mute nothing")
        figures[f"{what}_lost_after_s"] = round(took_s, 2)
        # Without telemetry there is no place to hold at: the gate lets nothing out, and that ends the stream sooner.
        assert status["reason"] == "link_lost" or (what, status["reason"]) == ("everything", "stalled")
        # The bar is 1.5 s after the newest heartbeat; one may have come just before the silence began.
        assert took_s <= 1.5 + 0.2
        await asyncio.sleep(1.5)
        report = await flying.px4()
        assert report.setpoints == sent.setpoints and report.mode == "HOLD"
        assert (await flying.status())["state"] == "latched", "only a person engages again"
    record(8, **figures)


async def test_fault_03_a_service_that_stood_still_is_idle_after_it(flying: Flying) -> None:
    late = 0
    for stall_s in (0.7, 3.0)[-runs(1, 2) :]:
        await flying.fly()
        await asyncio.sleep(0.5)
        pid = flying.cast.pid("uav")
        os.kill(pid, signal.SIGSTOP)
        await asyncio.sleep(stall_s)
        stood = await flying.px4()
        os.kill(pid, signal.SIGCONT)
        status = await flying.in_state("latched", timeout_s=5.0)
        await asyncio.sleep(1.0)
        after = await flying.px4()
        late = max(late, after.setpoints - stood.setpoints)
        assert status["reason"] in ("stalled", "mode_lost")  # whichever word of the autopilot was read first
        assert after.mode != "OFFBOARD" or stall_s < 1.0  # PX4 waits COM_OF_LOSS_T, 1 s, itself
    record(3, late_set_points=late)
    assert late <= 1
    assert (await flying.px4()).mode == "HOLD"


async def test_fault_01_a_blocked_event_loop_ends_the_stream(flying: Flying) -> None:
    await flying.fly()
    await asyncio.sleep(0.5)
    block_s = runs(3, 10)
    began_ns = time.monotonic_ns()
    flying.fault(f"block {block_s}")
    await asyncio.sleep(block_s - 0.2)
    blocked = await flying.px4()
    assert blocked.last_setpoint_mono_ns is not None
    last_s = (blocked.last_setpoint_mono_ns - began_ns) / NS_PER_S
    record(1, blocked_s=block_s, last_set_point_after_s=round(max(0.0, last_s), 3))
    assert last_s <= 0.2 and blocked.mode == "HOLD"
    await flying.in_state("latched", timeout_s=5.0)
    await asyncio.sleep(0.5)
    after = await flying.px4()
    assert after.setpoints - blocked.setpoints <= 1 and after.mode == "HOLD"


async def test_poses_reach_the_estimator_at_their_rate_in_its_axes(flying: Flying) -> None:
    await flying.fly()
    begin = await flying.px4()
    await asyncio.sleep(2.0)
    end = await flying.px4()
    rate_hz = (end.vision - begin.vision) * NS_PER_S / (end.t_mono_ns - begin.t_mono_ns)
    assert 25 <= rate_hz <= 32 and end.vision_age_s is not None and abs(end.vision_age_s) < 0.3
    assert end.vision_p_enu_m is not None
    # Where the camera began is not where the autopilot did: the height above the ground and the way flown agree.
    assert math.dist(end.vision_p_enu_m, end.p_enu_m) < 1.0


@contextmanager
def _burners(count: int) -> Iterator[None]:
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for burner in burners:
            burner.kill()
            burner.wait()


async def test_fault_05_the_stream_keeps_its_rate_under_load(flying: Flying) -> None:
    """Each second of it. Where real time is not permitted it is measured alone."""
    await flying.fly()
    in_real_time = os.sched_getscheduler(flying.cast.pid("uav")) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR
    rates_hz: list[float] = []
    with _burners(2 * (os.cpu_count() or 1)):
        await asyncio.sleep(1.0)
        first = before = await flying.px4("forget gaps")
        for _ in range(runs(6, 30)):
            await asyncio.sleep(1.0)
            now = await flying.px4()
            sent = now.setpoints_in_offboard - before.setpoints_in_offboard
            rates_hz.append(sent * NS_PER_S / (now.t_mono_ns - before.t_mono_ns))
            before = now
    gap_ms = 1000 * before.largest_gap_s
    record(
        5,
        rate_hz=round(sum(rates_hz) / len(rates_hz), 2),
        worst_second_hz=round(min(rates_hz), 1),
        largest_gap_ms=round(gap_ms),
        in_real_time=in_real_time,
    )
    if not in_real_time:
        pytest.skip("real-time priority is not permitted here; measured, not judged")
    assert first.mode == before.mode == "OFFBOARD"
    assert min(rates_hz) >= 18 and gap_ms <= 150


async def test_fault_41_a_suspended_host_is_latched(flying: Flying) -> None:
    await flying.fly()
    await asyncio.sleep(0.5)
    asked_ns = time.monotonic_ns()
    flying.fault("suspend 5")
    status = await flying.in_state("latched", timeout_s=5.0)
    await asyncio.sleep(1.5)
    report = await flying.px4()
    assert report.last_setpoint_mono_ns is not None
    last_s = (report.last_setpoint_mono_ns - asked_ns) / NS_PER_S
    record(41, last_set_point_after_s=round(max(0.0, last_s), 3))
    assert status["reason"] == "stalled" and last_s <= 0.2
    assert report.mode == "HOLD", "by the autopilot's own failsafe: nobody asked it"
    assert (await flying.status())["state"] == "latched"


async def test_fault_23_a_step_of_the_wall_clock_changes_nothing(flying: Flying) -> None:
    await flying.fly()
    begin = await flying.px4("forget gaps")
    for step_s in (30, -60):
        flying.fault(f"wall {step_s}")
        await asyncio.sleep(1.0)
    end = await flying.px4()
    status = await flying.status()
    rate_hz = (end.setpoints - begin.setpoints) * NS_PER_S / (end.t_mono_ns - begin.t_mono_ns)
    record(23, rate_hz=round(rate_hz, 1), largest_gap_ms=round(1000 * end.largest_gap_s), overruns=status["overruns"])
    assert end.mode == "OFFBOARD" and rate_hz >= 18 and status["streaming"]


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL], ids=lambda number: number.name)
async def test_fault_06_a_worker_that_hangs_or_dies_is_replaced(flying: Flying, number: signal.Signals) -> None:
    await flying.fly("approaching")
    await flying.until(lambda status: status["state"] == "approaching" and not status["bearing_stale"])
    (worker,) = flying.children("companion.sensing.worker")
    begin = await flying.px4("forget gaps")
    os.kill(worker, number)
    since_s = time.monotonic()
    await flying.until(lambda status: status["bearing_stale"], 10.0)
    stale_s = time.monotonic() - since_s
    replaced = await flying.until(lambda _: flying.children("companion.sensing.worker") not in ([], [worker]), 30.0)
    restarted_s = time.monotonic() - since_s
    await asyncio.sleep(max(0.0, 2.0 - restarted_s))
    end = await flying.px4()
    rate_hz = (end.setpoints - begin.setpoints) * NS_PER_S / (end.t_mono_ns - begin.t_mono_ns)
    gap_ms = 1000 * end.largest_gap_s
    record(6, stale_after_s=round(stale_s, 2), replaced_after_s=round(restarted_s, 1), gap_ms=round(gap_ms))
    assert stale_s <= 2.0
    assert replaced["streaming"] and rate_hz >= 18 and gap_ms <= 200
    await flying.until(lambda status: "the AOA worker is not ready" not in status["not_ready"], 30.0)


async def test_fault_17_a_gap_of_the_poses_holds_the_vehicle(flying: Flying) -> None:
    await flying.fly("acquiring", "approaching")
    flying.camera("pause")
    since_s = time.monotonic()
    await flying.in_state("holding", timeout_s=5.0)
    stale_s = time.monotonic() - since_s
    await asyncio.sleep(runs(3, 7) - stale_s)
    held = await flying.px4()
    flying.camera("pass")
    await flying.until(lambda status: status["health"]["poses"]["gap"] > 0, 5.0)
    record(17, holding_after_s=round(stale_s, 2), gap_s=runs(3, 7))
    assert stale_s <= 0.2 + 0.25 and math.hypot(*held.v_enu_m_s) < 0.3
    await flying.fly("acquiring", "approaching")


async def test_fault_18_a_jump_of_the_poses_drops_the_aperture_and_moves_nothing(flying: Flying) -> None:
    await flying.fly("acquiring", "approaching")
    await flying.until(lambda status: status["path_m"] > 0.2, 20.0)
    begin = await flying.px4("forget gaps")
    flying.camera("jump 1.0")
    speed_m_s, steps = 0.0, 30
    for _ in range(steps):
        await asyncio.sleep(0.05)
        speed_m_s = max(speed_m_s, math.hypot(*(await flying.px4()).v_enu_m_s))
    end = await flying.px4()
    status = await flying.status()
    log = (flying.out / "uav.txt").read_text()
    record(18, top_speed_after_m_s=round(speed_m_s, 2), jumps=status["health"]["poses"]["jump"])
    assert status["health"]["poses"]["jump"] == 1
    # What the estimator gets goes on without the jump, so nothing is to be set anew by it.
    assert begin.vision_reset_counter == end.vision_reset_counter == 0
    assert begin.vision_p_enu_m is not None and end.vision_p_enu_m is not None
    assert math.dist(begin.vision_p_enu_m, end.vision_p_enu_m) < 0.9 + math.dist(begin.p_enu_m, end.p_enu_m)
    assert end.setpoints > begin.setpoints and speed_m_s < 0.8  # legs are flown at 0.5 m/s
    if "refused: poses: jump" not in log:
        await flying.until(lambda _: "refused: poses: jump" in (flying.out / "uav.txt").read_text(), 15.0)


async def test_fault_29_a_silent_ground_robot_is_not_chased(flying: Flying) -> None:
    await flying.fly("approaching")
    await flying.until(lambda status: status["state"] == "approaching" and not status["bearing_stale"])
    os.kill(flying.cast.pid("beacon"), signal.SIGSTOP)
    since_s = time.monotonic()
    await flying.in_state("holding", timeout_s=10.0)
    silent_s = time.monotonic() - since_s
    await asyncio.sleep(1.0)
    held_m = (await flying.px4()).p_enu_m
    await asyncio.sleep(3.0)
    moved_m = math.dist(held_m, (await flying.px4()).p_enu_m)
    os.kill(flying.cast.pid("beacon"), signal.SIGCONT)
    record(29, holding_after_s=round(silent_s, 2), moved_in_3_s_m=round(moved_m, 2))
    assert moved_m < 0.3  # that it then returns shows in test_mission


async def test_fault_19_a_dead_camera_process_holds_and_is_replaced(flying: Flying) -> None:
    await flying.fly("acquiring", "approaching")
    (camera,) = flying.children("tests.faults.pose_relay")
    os.kill(camera, signal.SIGKILL)
    since_s = time.monotonic()
    await flying.in_state("holding", timeout_s=3.0)
    held_s = time.monotonic() - since_s
    await flying.until(lambda _: flying.children("tests.faults.pose_relay") not in ([], [camera]), 10.0)
    restarted_s = time.monotonic() - since_s
    # Its frame has a new yaw: poses wait until the autopilot's heading has told where North is.
    await flying.until(lambda status: not any("poses" in t or "North" in t for t in status["not_ready"]), 20.0)
    back_s = time.monotonic() - since_s
    record(
        19, holding_after_s=round(held_s, 2), restarted_after_s=round(restarted_s, 2), poses_after_s=round(back_s, 1)
    )
    assert held_s < 0.6 and restarted_s <= 5.0


async def test_fault_16_poses_that_are_no_numbers_land_the_vehicle(flying: Flying) -> None:
    await flying.fly()
    flying.camera("nan")
    since_s = time.monotonic()
    status = await flying.in_state("landing", timeout_s=3.0)
    lost_s = time.monotonic() - since_s
    await flying.until(lambda _: flying.now.vehicle.mode == "LAND", 5.0)
    seen = (await flying.px4()).vision
    await asyncio.sleep(0.2)
    assert (await flying.px4()).vision == seen, "what is no number is not for the estimator"
    flying.camera("pass")
    record(16, lost_after_s=round(lost_s, 2), then="land")
    assert status["reason"] == "pose_lost"
    assert lost_s <= 0.1 + 0.15  # the status is asked for every 20 ms, and the tick is 50 ms
    await flying.let_go()


async def test_a_low_battery_lands_the_vehicle(flying: Flying) -> None:
    await flying.fly()
    await flying.px4("battery 0.1")
    status = await flying.in_state("landing", timeout_s=3.0)
    await flying.until(lambda _: flying.now.vehicle.mode == "LAND", 5.0)
    await flying.px4("battery 0.9")
    assert status["reason"] == "battery_low" and not status["streaming"]
    await flying.let_go()


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
        await flying.restart()
    record(2, runs=count, last_set_point_after_s=round(last_s, 3), orphans=orphans)
    assert last_s <= 0.2 and orphans == 0


async def test_fault_27_an_unfed_watchdog_means_killed_and_idle(
    flying: Flying, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The test is the service manager: it kills what has not fed the watchdog for WatchdogSec (3 s), and restarts."""
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
