"""Pose datagrams of a reader process -> ENU poses of the body. T265 axes exist only here."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path

import numpy as np

from companion.core.messages import Pose
from companion.host.unix_datagram import bind_datagram_socket
from companion.pose import wire
from companion.pose.port import PoseSink
from wsr import frames


class BodyFrame:
    """Turns raw poses into North-aligned ENU poses of the body, by `north_yaw_rad` on the LEFT: it acts in the world.

    Both conversions are linear, so each is one matrix made once: this runs at 200 Hz on the event loop.
    """

    def __init__(self, north_yaw_rad: float) -> None:
        vector = {wire.PoseFrame.ENU: np.eye(3), wire.PoseFrame.T265: frames.enu_from_t265_vector(np.eye(3))}
        quaternion = {wire.PoseFrame.ENU: np.eye(4), wire.PoseFrame.T265: frames.enu_from_t265_quaternion(np.eye(4))}
        # Rows are the images of the unit vectors, hence the transposes.
        self._vector = {frame: frames.yaw_align(north_yaw_rad, rows).T for frame, rows in vector.items()}
        self._quaternion = {frame: frames.yaw_align(north_yaw_rad, rows).T for frame, rows in quaternion.items()}

    def pose(self, raw: wire.RawPose) -> Pose:
        turn = self._vector[raw.frame]
        x, y, z = turn.dot(raw.position_m).tolist()
        vx, vy, vz = turn.dot(raw.velocity_m_s).tolist()
        qw, qx, qy, qz = self._quaternion[raw.frame].dot(raw.quaternion_wxyz).tolist()
        return Pose(raw.t_mono_ns, (x, y, z), (qw, qx, qy, qz), (vx, vy, vz), raw.confidence)


class PoseSource:
    """Receives pose datagrams on a Unix socket it owns. `drain` is called when `fileno` is readable."""

    def __init__(self, path: Path, north_yaw_rad: float, on_pose: PoseSink) -> None:
        self._socket = bind_datagram_socket(path)
        self._path = path
        self._frame = BodyFrame(north_yaw_rad)
        self._on_pose = on_pose
        self._session: int | None = None
        self.received = 0
        self.malformed = 0
        self.resets = 0

    def align(self, north_yaw_rad: float) -> None:
        self._frame = BodyFrame(north_yaw_rad)

    def fileno(self) -> int:
        return self._socket.fileno()

    async def run(self) -> None:
        loop = asyncio.get_running_loop()
        loop.add_reader(self.fileno(), self.drain)
        try:
            await loop.create_future()
        finally:
            loop.remove_reader(self.fileno())

    def drain(self) -> None:
        while True:
            try:
                datagram = self._socket.recv(4096, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            self._take(datagram)

    def close(self) -> None:
        self._socket.close()
        self._path.unlink(missing_ok=True)

    def _take(self, datagram: bytes) -> None:
        try:
            raw = wire.decode(datagram)
        except wire.PoseWireError:
            self.malformed += 1
            return
        if self._session is not None and raw.session != self._session:
            self.resets += 1
        self._session = raw.session
        self.received += 1
        self._on_pose(self._frame.pose(raw))
