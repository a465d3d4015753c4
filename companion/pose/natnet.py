"""OptiTrack motion capture: NatNet frames over UDP, unicast (`companion.pose.natnet_frame` takes them apart).

The handshake is one
datagram (u16 message id 0, u16 length, "Ping" and a zero byte; little-endian) answered by SERVERINFO, which names the
protocol version; a keep-alive (message id 10) a second keeps a unicast server sending. A second without a frame that is
understood begins anew: a server that was restarted knows us no more, and one that was set to another version sends
frames of it to all.

Motive streams right-handed axes with Y up (its default) or Z up. Y up is turned as a fixed rotation C does that takes
(x, y, z) to (x, -z, y): p = C p, q = C q C^-1, so a rigid body that was made with its nose along Motive's X has body
axes forward, left, up. North is what `pose.north_yaw_deg` says of Motive's axes.

A frame holds when the server says that it does, on our clock by the least delayed of them: one that waited in a network
or in a queue is as old as it is. A server that repeats one frame (a paused take) tells of no body.
"""

from __future__ import annotations

import asyncio
import logging
import math
import socket
from typing import Final

import numpy as np

from companion.autopilot.vehicle_clock import VehicleClock
from companion.config.schema import NatNetConfig
from companion.core.clock import NS_PER_S, Clock
from companion.core.messages import Pose, Vector3
from companion.errors import CompanionError
from companion.host.coalescing import Readers
from companion.pose.autopilot import turned
from companion.pose.natnet_frame import (
    HEADER,
    Body,
    NatNetError,
    Version,
    body_in,
    ids_in,
    message_of,
    protocol_version,
)
from companion.pose.port import PoseSink
from csi_bridge.arrival import StampedSocket
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
_EXACT_TIME: Final = (2, 7)
"""Before, the time stamp is a float of 32 bits: 8 ms after a day."""
_FROZEN_NS: Final = NS_PER_S // 10
_LATE_NS: Final = NS_PER_S // 20
_FASTEST_M_S: Final = 50.0
_SILENT_TURNS: Final = 3


class NatNetPoses:
    """One rigid body of one server. A frame that lost the body is handed over with confidence 0."""

    def __init__(self, config: NatNetConfig, clock: Clock, on_pose: PoseSink) -> None:
        self._config = config
        self._clock = clock
        self._on_pose = on_pose
        self._north_rad = 0.0
        self._version: Version | None = None
        self._complained = set[str]()
        self._is_served = self._has_answered = self._has_sent = False
        """Of the last second: frames that were understood, an answer, any frame."""
        self._unserved = 0
        """Seconds without a frame that was understood."""
        self._without_ns: int | None = None
        """Since when frames lack our body."""
        self._previous: tuple[float, Vector3] | None = None
        self._frame = 0.0, 0
        """Time of the newest frame by the server, and when it came first."""
        self._server = VehicleClock()
        self._late_since_ns: int | None = None
        self.frozen = 0
        """Frames that only repeat the one before."""
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
        self._stamped = StampedSocket(self._socket)

    def align(self, north_yaw_rad: float) -> None:
        self._north_rad = north_yaw_rad

    async def run(self, readers: Readers | None = None) -> None:
        """Greets the server again and again until it answers, then keeps it sending."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket.fileno(), self._drain)
        try:
            while True:
                self._ask()
                await self._clock.sleep_until_ns(self._clock.now_ns() + NS_PER_S)
        finally:
            loop.remove_reader(self._socket.fileno())

    def close(self) -> None:
        self._socket.close()

    def _ask(self) -> None:
        """Once a second."""
        self._unserved = 0 if self._is_served else self._unserved + 1
        if self._unserved > _SILENT_TURNS and not self._has_sent:
            server = f"pose.natnet.server {self._config.server}"
            if not self._has_answered:
                self._complain(
                    "answer", f"{server}, port {self._config.port}: it does not answer; is Motive streaming?"
                )
            elif self._version is not None:
                self._complain("frames", f"{server} answers and sends no frames: it must stream, as unicast")
        greets = self._version is None or not self._is_served
        self._is_served = self._has_answered = self._has_sent = False
        message = b"Ping\0" if greets else b"\0"
        try:
            self._socket.send(HEADER.pack(_CONNECT if greets else _KEEPALIVE, len(message)) + message)
        except OSError:
            self._version = None  # the server is not there, or no longer

    def _drain(self) -> None:
        while True:
            try:
                datagram, _, arrived_ns = self._stamped.receive(_DATAGRAM_BYTES)
            except BlockingIOError:
                return
            except OSError:
                self._version = None
                return
            self._take(datagram, self._clock.now_ns() if arrived_ns is None else arrived_ns)

    def _take(self, datagram: bytes, arrived_ns: int) -> None:
        try:
            number, payload = message_of(datagram)
            if number == _SERVERINFO:
                self._has_answered = True
                self._greet(protocol_version(payload))
            elif number == _FRAMEOFDATA:
                self._has_sent = True
                if self._version is not None:
                    self._take_frame(payload, self._version, arrived_ns)
        except NatNetError as error:
            self.malformed += 1
            self._complain("datagram", f"a datagram of pose.natnet.server {self._config.server} is left out: {error}")

    def _take_frame(self, payload: bytes, version: Version, arrived_ns: int) -> None:
        """Raises NatNetError."""
        body = body_in(payload, version, self._config.body)
        self._is_served = True
        if body is not None:
            self._without_ns = None
            self._take_body(body, arrived_ns)
            return
        self._without_ns = self._without_ns or arrived_ns
        if arrived_ns - self._without_ns > NS_PER_S:
            there = ", ".join(map(str, ids_in(payload, version))) or "none"
            self._complain(
                "body",
                f"pose.natnet.body {self._config.body} is in no frame of {self._config.server}; in it are: {there}",
            )

    def _greet(self, version: Version) -> None:
        if self._version not in (None, version):
            _log.warning("pose.natnet.server %s speaks NatNet %s now", self._config.server, ".".join(map(str, version)))
        self._version = version if version >= _OLDEST else None
        if self._version is None:
            spoken, needed = (".".join(map(str, one)) for one in (version, _OLDEST))
            self._complain(
                "version",
                f"pose.natnet.server {self._config.server} speaks NatNet {spoken}, which does not tell whether a body "
                f"is tracked; {needed} or newer is needed",
            )

    def _complain(self, about: str, text: str) -> None:
        """Once of each thing: what follows is counted."""
        if about not in self._complained:
            self._complained.add(about)
            _log.warning("%s", text)

    def _held_ns(self, t_s: float, arrived_ns: int) -> int | None:
        """When a frame of the server's time `t_s` (0: it tells none) was so, on our clock; None where it is not new."""
        if t_s != self._frame[0]:
            self._frame = t_s, arrived_ns
        elif t_s and arrived_ns - self._frame[1] > _FROZEN_NS:
            if not self.frozen:
                _log.warning(
                    "pose.natnet.server %s repeats the frame of its time %.3f s, which is left out: is Motive paused?",
                    self._config.server, t_s,
                )  # fmt: skip
            self.frozen += 1
            return None
        if not t_s or self._version is None or self._version < _EXACT_TIME:
            return arrived_ns
        server_ns = round(t_s * NS_PER_S)
        self._server.told(server_ns, arrived_ns)
        late_ns = arrived_ns - server_ns + (self._server.offset_ns or server_ns - arrived_ns)
        if late_ns < _LATE_NS:
            self._late_since_ns = None
        elif self._late_since_ns is None:
            self._late_since_ns = arrived_ns
        elif arrived_ns - self._late_since_ns > NS_PER_S:  # no queue is so long: its clock was set back
            self._server, self._late_since_ns = VehicleClock(), None
            return arrived_ns
        return arrived_ns - max(0, late_ns)

    def _take_body(self, body: Body, arrived_ns: int) -> None:
        held_ns = self._held_ns(body.t_s, arrived_ns)
        if held_ns is None:
            return
        qx, qy, qz, qw = body.quaternion_xyzw
        p_m, q = self._enu(body.position_m, (qw, qx, qy, qz))
        confidence = 3 if body.is_tracked else 0
        velocity = self._velocity(body.t_s, p_m) if confidence else (0.0, 0.0, 0.0)
        self.received += 1
        self._on_pose(
            turned(
                Pose(t_mono_ns=held_ns, p_enu_m=p_m, q_enu_from_body=q, v_enu_m_s=velocity, confidence=confidence),
                self._north_rad,
            )
        )

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
