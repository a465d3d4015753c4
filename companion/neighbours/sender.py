"""What we broadcast: our poses, the channels we measured and our bearings, signed, and kept below a rate of bytes."""

from __future__ import annotations

from collections import OrderedDict, deque
from dataclasses import replace
from math import ceil, isfinite
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.core.clock import NS_PER_S
from companion.neighbours import wire
from companion.neighbours.bands import OF_5300, grid_of
from companion.neighbours.sightings import MAX_SIGHTINGS, Sighting
from wsr.reduced import reduce_channel

BYTES_PER_S: Final = 5000
"""The paper's budget, with the headers that a network interface counts."""
_SAVED_S: Final = 0.1
"""Of the budget, from what earlier datagrams left: batches differ by a few packets."""
_STALLED_S: Final = 0.5
_HEARD_NS: Final = 2 * NS_PER_S
_US_MASK: Final = (1 << 32) - 1
_TOLD: Final = 2
"""Times that a bearing is sent: a datagram may be lost, and none is asked for again."""
_SIGHTING_NS: Final = 30 * NS_PER_S
"""An older one is of no use."""

_Csi = tuple[int, int, int, npt.NDArray[np.complex64], int, int, int, int]


class NeighbourSender:
    """Collects poses and reverse channels and makes a signed datagram of them when asked. `boot_id` as of BootBook."""

    def __init__(
        self,
        *,
        role: wire.Role,
        own_id: int,
        key: bytes,
        pose_rate_hz: float,
        boot_id: int,
        budget_bytes_s: float = BYTES_PER_S,
    ) -> None:
        self._role = role
        self._id = own_id
        self._key = key
        self._pose_period_ns = round(NS_PER_S / pose_rate_hz)
        self._boot_id = boot_id
        self._counter = 0
        self._counted = True
        self._budget_bytes_s = budget_bytes_s
        self._newest_pose_ns = 0
        self._poses: deque[tuple[int, npt.ArrayLike, int]] = deque(maxlen=wire.MAX_POSES)
        self._csi: deque[_Csi] = deque(maxlen=2 * wire.MAX_CSI)
        self._sightings: deque[tuple[Sighting, int]] = deque(maxlen=4 * MAX_SIGHTINGS)
        """Bearings, and how often each is still to be sent."""
        self._heard: OrderedDict[int, tuple[int, int]] = OrderedDict()
        """(sending on its clock, arrival on ours) of the newest datagram of each robot, that echoed last at the end"""
        self._allowance = budget_bytes_s * _SAVED_S
        self._asked_ns: int | None = None
        self.dropped = 0
        """Values that a newer one pushed out because datagrams were not sent in time, or that fit no datagram."""
        self.thinned = 0
        """Channels left out, evenly, to stay below the budget of bytes."""
        self.sent_bytes = 0
        """With the headers that an interface counts."""

    def wants_pose(self, t_ns: int) -> bool:
        """Whether a pose of this time is due at the configured rate."""
        return t_ns - self._newest_pose_ns >= self._pose_period_ns * 0.9

    def add_pose(self, t_ns: int, p_enu_m: npt.ArrayLike, confidence: int) -> None:
        """Queues the antenna's position (3,) of one time."""
        self._newest_pose_ns = t_ns
        self.dropped += len(self._poses) == wire.MAX_POSES
        self._poses.append((t_ns, p_enu_m, confidence))

    def add_heard(self, robot: int, sent_ns: int, arrived_ns: int) -> None:
        """A datagram of another robot was accepted: it is told so, which bounds the relation of the clocks."""
        self._heard[robot] = sent_ns, arrived_ns

    def add_channel(
        self,
        frame: int | None,
        t_ns: int,
        nic_us: int,
        csi: npt.NDArray[np.complex64],
        *,
        power_dbm: float,
        antenna: int,
        band: int = OF_5300,
        ticks: int = 0,
    ) -> None:
        """Queues the channel (S,) of one packet; `frame` None where the driver gives no counter. `band` says which
        subcarriers these are, `ticks` is an AX card's fine clock."""
        self.dropped += len(self._csi) == self._csi.maxlen
        self._counted = frame is not None
        power = min(max(round(power_dbm), -128), 127) if isfinite(power_dbm) else -128
        self._csi.append((frame or 0, t_ns, nic_us, csi, power, antenna, band, ticks))

    def add_sighting(self, sighting: Sighting) -> None:
        """Queues a bearing that our own aperture gave."""
        self.dropped += len(self._sightings) == self._sightings.maxlen
        self._sightings.append((sighting, _TOLD))

    def datagrams(self, now_ns: int) -> list[bytes]:
        """Datagrams with all that was added since the last call: one, or none, or several after a stall or a restart of
        the pinging robot's counter. Sent at `now_ns`."""
        if self._asked_ns is not None:
            earned_s = min(_STALLED_S, (now_ns - self._asked_ns) / NS_PER_S)
            self._allowance = min(self._allowance, self._budget_bytes_s * _SAVED_S) + self._budget_bytes_s * earned_s
        self._asked_ns = now_ns
        poses = [pose for pose in self._poses if 0 <= now_ns - pose[0] < NS_PER_S]
        self.dropped += len(self._poses) - len(poses)
        parts = [_batch(part) for part in _split(self._csi)]
        self._poses.clear()
        self._csi.clear()
        made = []
        sightings = self._told(now_ns)
        for number in range(max(len(parts), 1 if poses or sightings else 0)):
            channels = parts[number] if parts else wire.empty_csi()
            first = number == 0
            data = self._datagram(poses if first else [], channels, sightings if first else (), now_ns)
            if data is not None:
                made.append(data)
                self.sent_bytes += len(data) + wire.FRAME_BYTES
                self._allowance -= len(data) + wire.FRAME_BYTES
        return made

    def note_unsent(self, data: bytes) -> None:
        """A datagram that the network did not take was not sent."""
        self.sent_bytes -= len(data) + wire.FRAME_BYTES

    def _told(self, now_ns: int) -> tuple[Sighting, ...]:
        """Bearings for this datagram; those that are to be sent again go behind the others."""
        told = []
        for _ in range(min(MAX_SIGHTINGS, len(self._sightings))):
            sighting, times = self._sightings.popleft()
            if not 0 <= now_ns - sighting.t_ns < _SIGHTING_NS:
                continue
            told.append(sighting)
            if times > 1:
                self._sightings.append((sighting, times - 1))
        return tuple(told)

    def _datagram(
        self,
        poses: list[tuple[int, npt.ArrayLike, int]],
        csi: wire.CsiBatch,
        sightings: tuple[Sighting, ...],
        now_ns: int,
    ) -> bytes | None:
        """With as many of the channels, evenly, as the budget has room for."""
        t_ns, p_enu_m, confidence = zip(*poses, strict=True) if poses else ((), (), ())
        datagram = wire.Datagram(
            role=self._role,
            sender=self._id,
            boot_id=self._boot_id,
            counter=self._counter,
            sent_ns=now_ns,
            poses=wire.PoseBatch(
                np.array(t_ns, np.int64), np.array(p_enu_m, float).reshape(-1, 3), np.array(confidence, np.uint8)
            ),
            csi=csi,
            counted=self._counted,
            echo=self._echo(now_ns),
            sightings=sightings,
        )
        self._counter += 1
        try:
            data = wire.encode(datagram, self._key)
            while (over := len(data) + wire.FRAME_BYTES - self._allowance) > 0 and len(datagram.csi):
                # The size of a channel depends on the others; an estimate that is too high thins a little too much.
                each = (len(data) - wire.OVERHEAD_BYTES) / len(datagram.csi)
                count = max(0, len(datagram.csi) - ceil(over / each))
                datagram = replace(datagram, csi=csi.rows(np.linspace(0, len(csi) - 1, count).astype(np.intp)))
                data = wire.encode(datagram, self._key)
        except ValueError:  # a jump of the tracker in mid batch, or a broken stamp: nobody could use it
            self.dropped += len(poses) + len(csi)
            return None
        self.thinned += len(csi) - len(datagram.csi)
        return data

    def _echo(self, now_ns: int) -> wire.Echo | None:
        """Of the robots heard of late, the one whose turn it is."""
        for robot, (sent_ns, arrived_ns) in self._heard.items():
            if 0 <= now_ns - arrived_ns < _HEARD_NS:
                self._heard.move_to_end(robot)
                return wire.Echo(robot, sent_ns // 1000 & _US_MASK, (now_ns - arrived_ns) // 1000)
        return None


def _split(csi: deque[_Csi]) -> list[list[_Csi]]:
    """Parts of which each fits one datagram: few enough, and counters and stamps not far from the first."""
    parts: list[list[_Csi]] = []
    for row in csi:
        first = parts[-1][0] if parts else None
        if (
            first is None
            or row[6] != first[6]
            or len(parts[-1]) == wire.most_channels(row[6])
            or (row[0] - first[0]) % (1 << 32) > wire.MAX_FRAME_STEP
            or (row[2] - first[2]) % (1 << 32) >= wire.NIC_SPAN_US
        ):
            parts.append([])
        parts[-1].append(row)
    return parts


def _batch(part: list[_Csi]) -> wire.CsiBatch:
    frame, t_ns, nic_us, csi, power, antenna, bands, ticks = zip(*part, strict=True)
    band = bands[0]
    coefficients, scale = reduce_channel(np.array(csi, np.complex64), grid_of(band))
    return wire.CsiBatch(
        frame=np.array(frame, np.uint32),
        t_ns=np.array(t_ns, np.int64),
        nic_us=np.array(nic_us, np.uint32),
        coefficients=coefficients,
        scale=scale,
        power_dbm=np.array(power, np.int8),
        antenna=np.array(antenna, np.uint8),
        band=band,
        ticks=None if band == OF_5300 else np.array(ticks, np.uint32),
    )
