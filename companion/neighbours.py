"""What the neighbours broadcast: who is there, their poses, and the reverse channels they measured."""

from __future__ import annotations

import asyncio
import secrets
import socket
import stat
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from companion import wire
from companion.clock import NS_PER_S, Clock
from companion.config import Config
from companion.errors import CompanionError, ConfigError

_Scalar = TypeVar("_Scalar", bound=np.generic)
_KEPT_DATAGRAMS = 400  # 40 s at 10 Hz: longer than any aperture takes


def read_key(path: Path) -> bytes:
    """The secret bytes in `path`. Raises ConfigError when it is missing, short, or readable by others."""
    try:
        mode = path.stat().st_mode
        key = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the key: {error.strerror}") from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ConfigError(f"{path}: the key must be readable by its owner only: chmod 600 {path}")
    if len(key) < wire.MIN_KEY_BYTES:
        raise ConfigError(f"{path}: {len(key)} bytes of key, expected at least {wire.MIN_KEY_BYTES}")
    return key


@dataclass(slots=True)
class Neighbour:
    """One robot we listen to and its newest datagrams with the time they arrived."""

    id: int
    name: str
    boot_id: int | None = None
    counter: int = -1
    heard_ns: int | None = None
    accepted: int = 0
    refused_old: int = 0
    received: deque[tuple[int, wire.Datagram]] = field(default_factory=lambda: deque(maxlen=_KEPT_DATAGRAMS))

    def channels_since(self, since_ns: int) -> wire.CsiBatch:
        """All reverse channels that arrived at or after `since_ns` (our clock)."""
        batches = [datagram.csi for arrived_ns, datagram in self.received if arrived_ns >= since_ns]
        return wire.CsiBatch(
            _joined([b.frame for b in batches], np.uint32),
            _joined([b.t_ns for b in batches], np.int64),
            _joined([b.nic_us for b in batches], np.uint32),
            _joined([b.value for b in batches], np.complex64),
            _joined([b.antenna for b in batches], np.uint8),
        )

    def newest_pose(self) -> tuple[int, tuple[float, float, float]] | None:
        """Boot id and antenna position (ENU, its own frame) of the newest datagram with poses; None before one."""
        for _, datagram in reversed(self.received):
            if len(datagram.poses.t_ns):
                x, y, z = datagram.poses.p_enu_m[-1].tolist()
                return datagram.boot_id, (x, y, z)
        return None

    def poses(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Times (N,) on the neighbour's clock, in order, and positions (N, 3) in its North-aligned frame."""
        t_ns = _joined([d.poses.t_ns for _, d in self.received], np.int64)
        p_enu_m = np.concatenate([np.zeros((0, 3)), *(d.poses.p_enu_m for _, d in self.received)])
        order = np.argsort(t_ns, kind="stable")  # datagrams may arrive out of order
        return t_ns[order], p_enu_m[order]


@dataclass(slots=True)
class LinkCounters:
    """Datagrams that no neighbour accounts for."""

    malformed: int = 0
    unknown_sender: int = 0
    own: int = 0
    bad_signature: int = 0


class NeighbourReceiver:
    """Authenticates datagrams and files them with the neighbour they came from."""

    def __init__(self, own_id: int, names: Mapping[int, str], keys: Mapping[int, bytes], clock: Clock) -> None:
        self._own_id = own_id
        self._keys = keys
        self._clock = clock
        self.neighbours = {peer: Neighbour(peer, name) for peer, name in names.items()}
        self.counters = LinkCounters()

    def take(self, data: bytes) -> bool:
        """Files one datagram; False when it was refused (and counted)."""
        try:
            sender = wire.sender_of(data)
        except wire.WireError:
            self.counters.malformed += 1
            return False
        if sender == self._own_id:  # a broadcast comes back to its sender
            self.counters.own += 1
            return False
        neighbour = self.neighbours.get(sender)
        if neighbour is None:
            self.counters.unknown_sender += 1
            return False
        try:
            datagram = wire.decode(data, self._keys[sender])
        except wire.WireError:
            self.counters.bad_signature += 1
            return False
        return self._file(neighbour, datagram)

    def _file(self, neighbour: Neighbour, datagram: wire.Datagram) -> bool:
        if datagram.boot_id != neighbour.boot_id:
            # Another boot has another clock: nothing of the old one can be joined with it.
            neighbour.boot_id, neighbour.counter = datagram.boot_id, -1
            neighbour.received.clear()
        if datagram.counter <= neighbour.counter:
            neighbour.refused_old += 1
            return False
        neighbour.counter = datagram.counter
        neighbour.heard_ns = self._clock.now_ns()
        neighbour.accepted += 1
        neighbour.received.append((neighbour.heard_ns, datagram))
        return True


class NeighbourSender:
    """Collects our poses and reverse channels and makes a signed datagram of them when asked."""

    def __init__(self, role: wire.Role, own_id: int, key: bytes, pose_rate_hz: float) -> None:
        self._role = role
        self._id = own_id
        self._key = key
        self._pose_period_ns = round(NS_PER_S / pose_rate_hz)
        self._boot_id = secrets.randbits(64)
        self._counter = 0
        self._newest_pose_ns = 0
        self._poses: deque[tuple[int, npt.ArrayLike, int]] = deque(maxlen=wire.MAX_POSES)
        self._csi: deque[tuple[int, int, int, complex, int]] = deque(maxlen=wire.MAX_CSI)
        self.dropped = 0
        """Values that a newer one pushed out because datagrams were not sent in time."""

    def wants_pose(self, t_ns: int) -> bool:
        """Whether a pose of this time is due at the configured rate."""
        return t_ns - self._newest_pose_ns >= self._pose_period_ns * 0.9

    def add_pose(self, t_ns: int, p_enu_m: npt.ArrayLike, confidence: int) -> None:
        """Queues the antenna's position (3,) of one time."""
        self._newest_pose_ns = t_ns
        self.dropped += len(self._poses) == wire.MAX_POSES
        self._poses.append((t_ns, p_enu_m, confidence))

    def add_channel(self, frame: int, t_ns: int, nic_us: int, value: complex, antenna: int) -> None:
        self.dropped += len(self._csi) == wire.MAX_CSI
        self._csi.append((frame, t_ns, nic_us, value, antenna))

    def datagram(self) -> bytes | None:
        """The next datagram with all that was added since the last, or None when that is nothing."""
        if not self._poses and not self._csi:
            return None
        t_ns, p_enu_m, confidence = zip(*self._poses, strict=True) if self._poses else ((), (), ())
        frame, csi_t_ns, nic_us, value, antenna = zip(*self._csi, strict=True) if self._csi else ((), (), (), (), ())
        datagram = wire.Datagram(
            self._role,
            self._id,
            self._boot_id,
            self._counter,
            wire.PoseBatch(
                np.array(t_ns, np.int64), np.array(p_enu_m, float).reshape(-1, 3), np.array(confidence, np.uint8)
            ),
            wire.CsiBatch(
                np.array(frame, np.uint32),
                np.array(csi_t_ns, np.int64),
                np.array(nic_us, np.uint32),
                np.array(value, np.complex64),
                np.array(antenna, np.uint8),
            ),
        )
        self._counter += 1
        self._poses.clear()
        self._csi.clear()
        return wire.encode(datagram, self._key)


class _Protocol(asyncio.DatagramProtocol):
    def __init__(self, on_datagram: Callable[[bytes], None]) -> None:
        self._on_datagram = on_datagram

    def datagram_received(self, data: bytes, addr: tuple[str | object, int]) -> None:
        self._on_datagram(data)


async def open_link(config: Config, on_datagram: Callable[[bytes], None]) -> asyncio.DatagramTransport:
    """A UDP socket on the neighbours' port that can broadcast. Raises CompanionError when it cannot be had."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # each robot of a simulation hears each broadcast
    sock.setblocking(False)
    try:
        # Bound to the broadcast address itself: nothing sent to one host only is taken for a broadcast.
        sock.bind((config.neighbours.broadcast, config.neighbours.port))
    except OSError as error:
        sock.close()
        raise CompanionError(
            f"neighbours.port {config.neighbours.port}: cannot bind {config.neighbours.broadcast}: {error.strerror}"
        ) from None
    transport, _ = await asyncio.get_running_loop().create_datagram_endpoint(lambda: _Protocol(on_datagram), sock=sock)
    return transport


def _joined(parts: list[npt.NDArray[_Scalar]], dtype: type[_Scalar]) -> npt.NDArray[_Scalar]:
    return np.concatenate([np.zeros(0, dtype), *parts])
