"""The autopilot's odometry as poses: from another thread, in order, and never more than may wait."""

from __future__ import annotations

import asyncio
import math
import threading
from dataclasses import replace

import pytest

from companion.core.messages import Pose
from companion.pose.autopilot import AutopilotPoses, turned

_POSE = Pose(
    t_mono_ns=7, p_enu_m=(1.0, 0.0, 2.0), q_enu_from_body=(1.0, 0.0, 0.0, 0.0), v_enu_m_s=(0.5, 0.0, -0.1), confidence=3
)


def test_axes_are_turned_counter_clockwise_about_up() -> None:
    pose = turned(_POSE, math.pi / 2)
    assert pose.p_enu_m == pytest.approx((0.0, 1.0, 2.0))
    assert pose.v_enu_m_s == pytest.approx((0.0, 0.5, -0.1))
    half = math.sqrt(0.5)
    assert pose.q_enu_from_body == pytest.approx((half, 0.0, 0.0, half))
    assert (pose.t_mono_ns, pose.confidence) == (7, 3)
    assert turned(_POSE, 0.0) is _POSE


async def test_poses_of_a_thread_come_out_on_the_loop_in_their_order() -> None:
    got: list[tuple[int, int]] = []
    done = asyncio.Event()

    def take(pose: Pose) -> None:
        got.append((pose.t_mono_ns, threading.get_ident()))
        if len(got) == 20:
            done.set()

    source = AutopilotPoses(take)
    running = asyncio.create_task(source.run())
    await asyncio.sleep(0)

    def offer() -> None:
        for n in range(20):
            source.offer(replace(_POSE, t_mono_ns=n))

    thread = threading.Thread(target=offer)
    thread.start()
    await asyncio.wait_for(done.wait(), 30)
    thread.join()
    running.cancel()
    assert got == [(n, threading.get_ident()) for n in range(20)]
    assert (source.received, source.dropped) == (20, 0)


async def test_of_poses_that_nobody_takes_the_oldest_go_and_are_counted() -> None:
    got: list[int] = []
    source = AutopilotPoses(lambda pose: got.append(pose.t_mono_ns))
    for n in range(100):
        source.offer(replace(_POSE, t_mono_ns=n))
    assert source.dropped == 36
    running = asyncio.create_task(source.run())
    await asyncio.sleep(0)
    source.offer(replace(_POSE, t_mono_ns=100))
    await asyncio.sleep(0)
    await asyncio.sleep(0)
    running.cancel()
    assert got == list(range(37, 101))


def test_who_has_closed_keeps_nothing() -> None:
    source = AutopilotPoses(lambda pose: None)
    source.offer(_POSE)
    source.close()
    source.close()  # harmless when repeated
    assert not source._waiting
