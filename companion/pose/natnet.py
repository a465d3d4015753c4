"""OptiTrack motion capture: NatNet frames over UDP, unicast (`companion.pose.natnet_frame` takes them apart).

The handshake is one
datagram (u16 message id 0, u16 length, "Ping" and a zero byte; little-endian) answered by SERVERINFO, which names the
protocol version; a keep-alive (message id 10) a second keeps a unicast server sending.

Motive streams right-handed axes with Y up (its default) or Z up. Y up is turned as a fixed rotation C does that takes
(x, y, z) to (x, -z, y): p = C p, q = C q C^-1, so a rigid body that was made with its nose along Motive's X has body
axes forward, left, up. North is what `pose.north_yaw_deg` says of Motive's axes.
"""

from __future__ import annotations

import asyncio
import logging
import math
import socket
from typing import Final

import numpy as np

from companion.config.schema import NatNetConfig
from companion.core.clock import NS_PER_S, Clock
from companion.core.messages import Pose, Vector3
from companion.errors import CompanionError
from companion.host.coalescing import Readers
from companion.pose.autopilot import turned
from companion.pose.natnet_frame import HEADER, Body, NatNetError, Version, body_in, message_of, protocol_version
from companion.pose.port import PoseSink
from wsr.geometry import quaternion_conjugate, quaternion_multiply

_log = logging.getLogger(__name__)
_CONNECT: Final = 0
_SERVERINFO: Final = 1
_FRAMEOFDATA: Final = 7
_KEEPALIVE: Final = 10
_Q_ENU_FROM_Y_UP: Final = np.array([math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0])
_DATAGRAM_BYTES: Final = 65536
_OLDEST: Final = (2, 6)
"""Before, nothing tells whether a body is tracked."""
_FASTEST_M_S: Final = 50.0


class NatNetPoses:
    """One rigid body of one server. A frame that lost the body is handed over with confidence 0."""

    def __init__(self, config: NatNetConfig, clock: Clock, on_pose: PoseSink) -> None:
        self._config = config
        self._clock = clock
        self._on_pose = on_pose
        self._north_rad = 0.0
        self._version: Version | None = None
        self._complained = False
        self._previous: tuple[float, Vector3] | None = None
        self.received = 0
        self.malformed = 0
        self.resets = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.connect((config.server, config.port))
        except OSError as error:
            self._socket.close()
            raise CompanionError(f"pose.natnet.server {config.server}: {error.strerror}") from None

    def align(self, north_yaw_rad: float) -> None:
        self._north_rad = north_yaw_rad

    async def run(self, readers: Readers | None = None) -> None:
        """Greets the server again and again until it answers, then keeps it sending."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket.fileno(), self._drain)
        try:
            while True:
                message = b"Ping\0" if self._version is None else b"\0"
                number = _CONNECT if self._version is None else _KEEPALIVE
                try:
                    self._socket.send(HEADER.pack(number, len(message)) + message)
                except OSError:
                    self._version = None  # the server is not there, or no longer
                await self._clock.sleep_until_ns(self._clock.now_ns() + NS_PER_S)
        finally:
            loop.remove_reader(self._socket.fileno())

    def close(self) -> None:
        self._socket.close()

    def _drain(self) -> None:
        while True:
            try:
                datagram = self._socket.recv(_DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except OSError:
                self._version = None
                return
            self._take(datagram, self._clock.now_ns())

    def _take(self, datagram: bytes, now_ns: int) -> None:
        try:
            number, payload = message_of(datagram)
            if number == _SERVERINFO:
                self._greet(protocol_version(payload))
            elif number == _FRAMEOFDATA and self._version is not None:
                body = body_in(payload, self._version, self._config.body)
                if body is not None:
                    self._take_body(body, now_ns)
        except NatNetError as error:
            self.malformed += 1
            self._complain(f"a datagram of pose.natnet.server {self._config.server} is left out: {error}")

    def _greet(self, version: Version) -> None:
        self._version = version if version >= _OLDEST else None
        if self._version is None:
            spoken, needed = (".".join(map(str, one)) for one in (version, _OLDEST))
            self._complain(
                f"pose.natnet.server {self._config.server} speaks NatNet {spoken}, which does not tell whether a body "
                f"is tracked; {needed} or newer is needed"
            )

    def _complain(self, text: str) -> None:
        """Once: what follows is counted."""
        if not self._complained:
            self._complained = True
            _log.warning("%s", text)

    def _take_body(self, body: Body, now_ns: int) -> None:
        qx, qy, qz, qw = body.quaternion_xyzw
        p_m, q = self._enu(body.position_m, (qw, qx, qy, qz))
        confidence = 3 if body.is_tracked else 0
        velocity = self._velocity(body.t_s, p_m) if confidence else (0.0, 0.0, 0.0)
        self.received += 1
        self._on_pose(turned(Pose(now_ns, p_m, q, velocity, confidence), self._north_rad))

    def _enu(self, p: Vector3, q_wxyz: tuple[float, ...]) -> tuple[Vector3, tuple[float, float, float, float]]:
        x, y, z = map(float, p)
        if self._config.up == "z":
            w, qx, qy, qz = map(float, q_wxyz)
            return (x, y, z), (w, qx, qy, qz)
        conjugated = quaternion_multiply(
            quaternion_multiply(_Q_ENU_FROM_Y_UP, q_wxyz), quaternion_conjugate(_Q_ENU_FROM_Y_UP)
        )
        w, qx, qy, qz = np.asarray(conjugated).tolist()
        return (x, -z, y), (w, qx, qy, qz)

    def _velocity(self, t_s: float, p_m: Vector3) -> Vector3:
        """From the positions of two frames: NatNet carries none. Zero over a jump, which the health sees for itself."""
        before, self._previous = self._previous, (t_s, p_m)
        if before is None or not 0 < t_s - before[0] < 1:
            return (0.0, 0.0, 0.0)
        x, y, z = ((p - q) / (t_s - before[0]) for p, q in zip(p_m, before[1], strict=True))
        return (x, y, z) if math.hypot(x, y, z) < _FASTEST_M_S else (0.0, 0.0, 0.0)
