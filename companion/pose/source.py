"""Pose datagrams of a reader process -> ENU poses of the body. T265 axes exist only here."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import socket
from collections import deque
from pathlib import Path
from typing import Final

import numpy as np

from companion.core.clock import NS_PER_S
from companion.core.messages import Pose
from companion.errors import CompanionError
from companion.host.coalescing import Readers
from companion.host.unix_datagram import bind_datagram_socket
from companion.pose import wire
from companion.pose.port import PoseSink
from wsr import frames

_log = logging.getLogger(__name__)
_LEFT: Final = 8
"""Sessions that are remembered as over."""
_SILENT_NS: Final = NS_PER_S
_WATCH_S: Final = 1.0


class BodyFrame:
    """Turns raw poses into North-aligned ENU poses of the body, by `north_yaw_rad` on the LEFT: it acts in the world.

    Both conversions are linear, so each is one matrix made once: this runs at 200 Hz on the event loop, where NumPy's
    products of single vectors cost more than the multiplying.
    """

    def __init__(self, north_yaw_rad: float) -> None:
        vector = {wire.PoseFrame.ENU: np.eye(3), wire.PoseFrame.T265: frames.enu_from_t265_vector(np.eye(3))}
        quaternion = {wire.PoseFrame.ENU: np.eye(4), wire.PoseFrame.T265: frames.enu_from_t265_quaternion(np.eye(4))}
        # Rows are the images of the unit vectors, hence the transposes.
        self._vector = {frame: frames.yaw_align(north_yaw_rad, rows).T.tolist() for frame, rows in vector.items()}
        self._quaternion = {
            frame: frames.yaw_align(north_yaw_rad, rows).T.tolist() for frame, rows in quaternion.items()
        }

    def pose(self, raw: wire.RawPose) -> Pose:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self._vector[raw.frame]
        x, y, z = raw.position_m
        vx, vy, vz = raw.velocity_m_s
        w, i, j, k = raw.quaternion_wxyz
        (aw, ai, aj, ak), (bw, bi, bj, bk), (cw, ci, cj, ck), (dw, di, dj, dk) = self._quaternion[raw.frame]
        return Pose(
            t_mono_ns=raw.t_mono_ns,
            p_enu_m=(ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z),
            q_enu_from_body=(
                aw * w + ai * i + aj * j + ak * k,
                bw * w + bi * i + bj * j + bk * k,
                cw * w + ci * i + cj * j + ck * k,
                dw * w + di * i + dj * j + dk * k,
            ),
            v_enu_m_s=(ax * vx + ay * vy + az * vz, bx * vx + by * vy + bz * vz, cx * vx + cy * vy + cz * vz),
            confidence=raw.confidence,
        )


class PoseSource:
    """Receives pose datagrams on a Unix socket it owns. `drain` is called when `fileno` is readable."""

    def __init__(self, path: Path, north_yaw_rad: float, on_pose: PoseSink) -> None:
        self._socket = bind_datagram_socket(path)
        self._path = path
        self._frame = BodyFrame(north_yaw_rad)
        self._on_pose = on_pose
        self._gathered: list[bytes] = []
        self._session: int | None = None
        self._left: deque[int] = deque(maxlen=_LEFT)
        self._newest_ns = 0
        self.strangers = 0
        """Datagrams of a reader beside the one whose poses are taken."""
        self.received = 0
        self.malformed = 0
        self.resets = 0

    def align(self, north_yaw_rad: float) -> None:
        self._frame = BodyFrame(north_yaw_rad)

    def fileno(self) -> int:
        return self._socket.fileno()

    async def run(self, readers: Readers | None = None) -> None:
        """Until cancelled. A socket whose file was taken away is made anew: no reader would find it."""
        self._attach(readers)
        try:
            while True:
                await asyncio.sleep(_WATCH_S)
                if not self._path.is_socket():
                    self._renew(readers)
        finally:
            self._detach(readers)

    def _renew(self, readers: Readers | None) -> None:
        try:
            fresh = bind_datagram_socket(self._path)
        except CompanionError as error:
            _log.debug("%s", error)  # poses are missed already, which is told
            return
        _log.warning("%s was taken away; it is there again", self._path)
        self.drain()
        self._detach(readers)
        self._socket.close()
        self._socket = fresh
        self._attach(readers)

    def _attach(self, readers: Readers | None) -> None:
        if readers is None:
            asyncio.get_running_loop().add_reader(self.fileno(), self.drain)
        else:
            readers.add_reader(self.fileno(), self.drain, gather=self.gather)

    def _detach(self, readers: Readers | None) -> None:
        (asyncio.get_running_loop() if readers is None else readers).remove_reader(self.fileno())

    def gather(self) -> int:
        """Keeps what waits for `drain`; how many datagrams that were."""
        before = len(self._gathered)
        with contextlib.suppress(BlockingIOError):
            while True:
                self._gathered.append(self._socket.recv(4096, socket.MSG_DONTWAIT))
        return len(self._gathered) - before

    def drain(self) -> int:
        """Takes what waits and what was gathered; how many datagrams that were."""
        self.gather()
        datagrams, self._gathered = self._gathered, []
        for datagram in datagrams:
            self._take(datagram)
        return len(datagrams)

    def close(self) -> None:
        self._socket.close()
        with contextlib.suppress(OSError):
            self._path.unlink(missing_ok=True)

    def _take(self, datagram: bytes) -> None:
        try:
            raw = wire.decode(datagram)
        except wire.PoseWireError:
            self.malformed += 1
            return
        if raw.session != self._session and not self._begin(raw):
            return
        self._newest_ns = raw.t_mono_ns
        self.received += 1
        self._on_pose(self._frame.pose(raw))

    def _begin(self, raw: wire.RawPose) -> bool:
        """Another session: a reader that began anew, or, where one comes back that had been left for another, two
        readers at once. Then the later one is kept, while it sends."""
        if raw.session in self._left and abs(raw.t_mono_ns - self._newest_ns) < _SILENT_NS:
            if not self.strangers:
                _log.warning(
                    "%s: two camera readers send to it; the later one's poses are taken, the other's left out: end "
                    "one of them (pose.reader_command starts one, systemd may start another)",
                    self._path,
                )
            self.strangers += 1
            return False
        if self._session is not None:
            self.resets += 1
            self._left.append(self._session)
        self._session = raw.session
        return True
