"""The autopilot's own odometry as a source of poses: no camera, and as good as its estimator is."""

from __future__ import annotations

import asyncio
from collections import deque

from companion.core.messages import Pose
from companion.host.coalescing import Readers
from companion.pose.port import PoseSink
from wsr import frames

_WAITING = 64


class AutopilotPoses:
    """`offer` is called by the MAVLink library's thread; poses wait in a bounded queue, of which the oldest goes."""

    def __init__(self, on_pose: PoseSink) -> None:
        self._on_pose = on_pose
        self._waiting: deque[Pose] = deque(maxlen=_WAITING)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._north_rad = 0.0
        self.received = 0
        self.malformed = 0
        self.resets = 0
        self.dropped = 0

    def align(self, north_yaw_rad: float) -> None:
        self._north_rad = north_yaw_rad

    def offer(self, pose: Pose) -> None:
        """From any thread."""
        self.dropped += len(self._waiting) == _WAITING
        self._waiting.append(pose)
        loop = self._loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(self._drain)

    async def run(self, readers: Readers | None = None) -> None:
        self._loop = asyncio.get_running_loop()
        try:
            await self._loop.create_future()
        finally:
            self._loop = None

    def close(self) -> None:
        self._loop = None
        self._waiting.clear()

    def _drain(self) -> None:
        while self._waiting:
            self.received += 1
            self._on_pose(turned(self._waiting.popleft(), self._north_rad))


def turned(pose: Pose, north_yaw_rad: float) -> Pose:
    """A pose with its world axes turned counter-clockwise about Up."""
    if north_yaw_rad == 0.0:
        return pose
    x, y, z = frames.yaw_align(north_yaw_rad, pose.p_enu_m).tolist()
    w, qx, qy, qz = frames.yaw_align(north_yaw_rad, pose.q_enu_from_body).tolist()
    vx, vy, vz = frames.yaw_align(north_yaw_rad, pose.v_enu_m_s).tolist()
    return Pose(
        t_mono_ns=pose.t_mono_ns,
        p_enu_m=(x, y, z),
        q_enu_from_body=(w, qx, qy, qz),
        v_enu_m_s=(vx, vy, vz),
        confidence=pose.confidence,
    )
