"""One SAR iteration: forward and reverse channels, joined by exchange, over the displacement of both robots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from companion.clock import NS_PER_S
from companion.history import History
from companion.messages import Pose, Vector3
from companion.neighbours import Neighbour
from companion.radio import ANTENNAS, ChannelSample
from wsr.aperture import Aperture, make_aperture
from wsr.channel import pair_by_counter, strongest_antenna
from wsr.displacement import antenna_positions, interpolate
from wsr.errors import ApertureError

_POSE_CAPACITY = 200 * 60
_SAMPLE_CAPACITY = 200 * 60
_NIC_WRAP_US = float(1 << 32)
_REVERSE_LEAD_NS = NS_PER_S  # a reverse channel may arrive before its forward one is drained
_FRAME, _NIC, _RE, _IM = 0, 1, slice(2, 2 + ANTENNAS), slice(2 + ANTENNAS, 2 + 2 * ANTENNAS)


@dataclass(frozen=True, slots=True)
class ApertureReport:
    """What one SAR iteration gathered from one peer: an aperture, or the reason why there is none."""

    peer: int
    start_ns: int
    end_ns: int
    aperture: Aperture | None
    refusal: str
    received: int
    """Forward packets heard in the time of the aperture."""
    dropped: Mapping[str, int]
    """Packets left out, per reason."""
    peer_t_s: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    """Times (M,) of the aperture's packets from `start_ns`, rising."""
    peer_p_m: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    """Where the peer's antenna was then, (M, 3), in its own frame with North-aligned axes."""
    peer_boot: int = 0

    def peer_at(self, t_ns: int) -> Vector3:
        """Where the peer's antenna was at a time [ns] within the aperture, in its own frame."""
        t_s = (t_ns - self.start_ns) / NS_PER_S
        x, y, z = (float(np.interp(t_s, self.peer_t_s, self.peer_p_m[:, axis])) for axis in range(3))
        return x, y, z


class SarWindow:
    """Keeps what the radio and the camera deliver and cuts apertures out of it."""

    def __init__(self, antenna_m: Vector3, wavelength_m: float, min_packets: int, max_pose_gap_s: float) -> None:
        self._antenna_m = antenna_m
        self._wavelength_m = wavelength_m
        self._min_packets = min_packets
        self._max_pose_gap_s = max_pose_gap_s
        self._poses = History(_POSE_CAPACITY, 7)
        self._samples: dict[int, History] = {}

    def add_pose(self, pose: Pose) -> None:
        """A pose of our own body; the aperture is made of where that puts the antenna."""
        self._poses.append(pose.t_mono_ns, (*pose.p_enu_m, *pose.q_enu_from_body))

    def add_sample(self, sample: ChannelSample) -> None:
        history = self._samples.setdefault(sample.peer, History(_SAMPLE_CAPACITY, 2 + 2 * ANTENNAS))
        values = sample.values
        history.append(sample.t_mono_ns, [sample.frame, sample.nic_us, *values.real, *values.imag])

    def path_length_m(self, start_ns: int, end_ns: int) -> float:
        """Length of the antenna's path, sampled at 20 Hz so that pose jitter does not count as motion."""
        t_ns, p_m = self._antenna(start_ns, end_ns)
        if len(t_ns) < 2:
            return 0.0
        at = np.arange(t_ns[0], t_ns[-1], NS_PER_S // 20)
        coarse = np.stack([np.interp(at, t_ns, p_m[:, axis]) for axis in range(3)], axis=1)
        return float(np.linalg.norm(np.diff(coarse, axis=0), axis=1).sum())

    def cut(self, neighbour: Neighbour, start_ns: int, end_ns: int) -> ApertureReport:
        """The aperture of the packets that `neighbour` sent between two times [ns]. Never raises for bad data: a
        refusal is part of the report."""
        forward_t_ns, forward = self._forward(neighbour.id, start_ns, end_ns)
        dropped: dict[str, int] = {}
        try:
            aperture, peer_p_m = self._join(neighbour, forward_t_ns, forward, start_ns, dropped)
        except ApertureError as error:
            return ApertureReport(neighbour.id, start_ns, end_ns, None, str(error), len(forward), dropped)
        assert neighbour.boot_id is not None
        return ApertureReport(
            neighbour.id, start_ns, end_ns, aperture, "", len(forward), dropped,
            aperture.t_s, peer_p_m, neighbour.boot_id,
        )  # fmt: skip

    def _antenna(self, start_ns: int, end_ns: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """Times (N,) [ns] and positions (N, 3) of our antenna."""
        t_ns, rows = self._poses.between(start_ns, end_ns)
        return t_ns, antenna_positions(rows[:, :3], rows[:, 3:], self._antenna_m)

    def _forward(self, peer: int, start_ns: int, end_ns: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        history = self._samples.get(peer)
        if history is None:
            return np.zeros(0, np.int64), np.zeros((0, 2 + 2 * ANTENNAS))
        t_ns, rows = history.between(start_ns, end_ns)
        inside = (t_ns >= start_ns) & (t_ns <= end_ns)
        return t_ns[inside], rows[inside]

    def _join(
        self,
        neighbour: Neighbour,
        forward_t_ns: npt.NDArray[np.int64],
        forward: npt.NDArray[np.float64],
        start_ns: int,
        dropped: dict[str, int],
    ) -> tuple[Aperture, npt.NDArray[np.float64]]:
        """The aperture and the peer's positions (M, 3) at its packets. Raises ApertureError."""
        if not len(forward):
            raise ApertureError(f"no packets of {neighbour.name} were heard")
        reverse = neighbour.channels_since(start_ns - _REVERSE_LEAD_NS)
        reverse_antenna = _most_common(reverse.antenna)
        usable = np.flatnonzero(reverse.antenna == reverse_antenna)
        i, j = pair_by_counter(forward[:, _FRAME].astype(np.uint32), reverse.frame[usable])
        dropped["unpaired"] = len(forward) - len(i)
        if not len(i):
            raise ApertureError(f"none of the {len(forward)} packets of {neighbour.name} has its reverse channel")
        j = usable[j]
        values = forward[i, _RE] + 1j * forward[i, _IM]
        ours, theirs = values[:, strongest_antenna(values[:, np.newaxis, :])], reverse.value[j]
        stamps_us = np.stack([forward[i, _NIC], reverse.nic_us[j].astype(float)], axis=1)
        nic_us = np.unwrap(stamps_us, axis=0, period=_NIC_WRAP_US)

        t_s = (forward_t_ns[i] - start_ns) / NS_PER_S
        own_t_ns, own_p_m = self._antenna(start_ns, int(forward_t_ns[-1]))
        p_i_m, own_valid = interpolate(t_s, (own_t_ns - start_ns) / NS_PER_S, own_p_m, self._max_pose_gap_s)
        # The neighbour's poses and channels carry its own clock: joined here by the exchange, with no clock relation.
        their_t_ns, their_p_m = neighbour.poses()
        base_ns = int(their_t_ns[0]) if len(their_t_ns) else 0
        p_j_m, their_valid = interpolate(
            (reverse.t_ns[j] - base_ns) / NS_PER_S,
            (their_t_ns - base_ns) / NS_PER_S,
            their_p_m,
            4 * self._max_pose_gap_s,
        )
        dropped["no own pose"] = int(np.count_nonzero(~own_valid))
        dropped["no neighbour pose"] = int(np.count_nonzero(own_valid & ~their_valid))
        keep = own_valid & their_valid
        aperture = make_aperture(
            t_s[keep],
            p_i_m[keep],
            ours[keep] * theirs[keep],
            self._wavelength_m,
            p_j_m=p_j_m[keep],
            min_packets=self._min_packets,
            forward=ours[keep, np.newaxis].astype(np.complex64),
            reverse=theirs[keep, np.newaxis].astype(np.complex64),
            nic_us=nic_us[keep],
        )
        return aperture, p_j_m[keep][np.argsort(t_s[keep], kind="stable")]


def _most_common(antenna: npt.NDArray[np.uint8]) -> int:
    return int(np.bincount(antenna).argmax()) if len(antenna) else 0
