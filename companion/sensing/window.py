"""One SAR iteration: forward and reverse channels, joined by exchange, over the displacement of both robots."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from companion.core.clock import NS_PER_S
from companion.core.messages import Pose, Vector3
from companion.neighbours import wire
from companion.neighbours.bands import OF_5300, grid_of, name_of
from companion.neighbours.clock_relation import card_times, match
from companion.neighbours.neighbour import Neighbour
from companion.radio.card import ANTENNAS, ChannelSample
from companion.sensing.centres import Centres
from companion.sensing.history import History
from companion.sensing.packets import FINE, FRAME, NIC, POWER, Packets, T
from csi_bridge.clock import NicClock
from csi_bridge.feitcsi.records import TICKS_PER_US
from csi_bridge.records import SUBCARRIERS
from wsr.aperture import Aperture, make_aperture
from wsr.channel import (
    SPEED_OF_LIGHT_M_S,
    band_wavelength_m,
    pair_by_counter,
    strongest_antenna,
)
from wsr.displacement import antenna_positions, interpolate
from wsr.errors import ApertureError
from wsr.ofdm import Grid
from wsr.reduced import restore_channel

_POSE_CAPACITY = 200 * 60
_SAMPLE_CAPACITY = 200 * 60
_NIC_WRAP_US = float(1 << 32)
_FINE_WRAP_US = float(1 << 32) / TICKS_PER_US
_REVERSE_LEAD_NS = NS_PER_S  # a reverse channel may arrive before its forward one is drained
_REMAP_NS = NS_PER_S  # a packet's time may move by so much while the relation of the clocks is young
_WEAK_COUNTS = 1.0  # CSI parts are whole numbers: below one count there is quantisation and no signal
_PATH_STEP_NS = NS_PER_S // 20

Times = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class ApertureReport:
    """What one SAR iteration gathered from one peer: an aperture, or the reason why there is none."""

    peer: int
    start_ns: int
    end_ns: int
    received: int
    """Forward packets heard in the time of the aperture."""
    power_dbm: float
    """Their mean power; NaN without packets."""
    dropped: Mapping[str, int]
    """Packets left out, per reason."""
    aperture: Aperture | None = None
    refusal: str = ""
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
    """Keeps what the radio and the camera deliver and cuts apertures out of it.

    With `nic_clock`, the card's own, the times of all packets are taken anew when an aperture is cut, since the
    relation of the clocks is known better then.
    """

    def __init__(
        self,
        *,
        antenna_m: Vector3,
        wavelength_m: float,
        min_packets: int,
        max_pose_gap_s: float,
        nic_clock: NicClock | None = None,
    ) -> None:
        self._antenna_m = antenna_m
        self._wavelength_m = wavelength_m
        self._min_packets = min_packets
        self._max_pose_gap_s = max_pose_gap_s
        self._poses = History(_POSE_CAPACITY, 7)
        self._heard: dict[int, dict[bytes, Packets]] = {}
        self._centres: dict[int, tuple[Centres, Centres]] = {}
        self._nic_clock = nic_clock

    def add_pose(self, pose: Pose) -> None:
        """A pose of our own body; the aperture is made of where that puts the antenna."""
        self._poses.append(pose.t_mono_ns, (*pose.p_enu_m, *pose.q_enu_from_body))

    def add_sample(self, sample: ChannelSample) -> None:
        heard = self._heard.setdefault(sample.peer, {})
        on = b"" if sample.subcarrier_hz is None else sample.subcarrier_hz.tobytes()
        if on not in heard:
            heard[on] = Packets(sample, _SAMPLE_CAPACITY)
        heard[on].add(sample)

    def body_at(self, t_ns: Times) -> npt.NDArray[np.float64]:
        """Where the pose source had our body (N, 3) at rising times (N,), in its own frame; as at its first and last
        pose before and after them."""
        pose_ns, rows = self._poses.between(int(t_ns[0]), int(t_ns[-1])) if len(t_ns) else self._poses.between(0, 0)
        if not len(pose_ns):
            return np.zeros((len(t_ns), 3))
        return np.stack([np.interp(t_ns, pose_ns, rows[:, axis]) for axis in range(3)], axis=1)

    def path_length_m(self, start_ns: int, end_ns: int) -> float:
        """Length of the antenna's path, sampled at 20 Hz so that pose jitter does not count as motion."""
        return float(self._path(start_ns, end_ns)[1].sum())

    def start_of_path(self, not_before_ns: int, end_ns: int, length_m: float) -> int | None:
        """The latest time from which the antenna has gone `length_m` until `end_ns`; None when it has not."""
        t_ns, steps_m = self._path(not_before_ns, end_ns)
        gone_m = np.cumsum(steps_m[::-1])
        if not len(gone_m) or gone_m[-1] < length_m:
            return None
        return int(t_ns[len(gone_m) - 1 - int(np.searchsorted(gone_m, length_m))])

    def _path(self, start_ns: int, end_ns: int) -> tuple[Times, npt.NDArray[np.float64]]:
        """Times (N,) [ns] and the lengths (N - 1,) [m] of the steps between them."""
        t_ns, p_m = self._antenna(start_ns, end_ns)
        if len(t_ns) < 2:
            return t_ns, np.zeros(0)
        at = np.arange(max(start_ns, t_ns[0]), min(end_ns, t_ns[-1]) + 1, _PATH_STEP_NS)
        coarse = np.stack([np.interp(at, t_ns, p_m[:, axis]) for axis in range(3)], axis=1)
        return at, np.linalg.norm(np.diff(coarse, axis=0), axis=1)

    def cut(self, neighbour: Neighbour, start_ns: int, end_ns: int) -> ApertureReport:
        """The aperture of the packets that `neighbour` sent between two times [ns]. Never raises for bad data: a
        refusal is part of the report."""
        forward = self._forward(neighbour.id, start_ns, end_ns)
        dropped: dict[str, int] = {}
        report = ApertureReport(
            peer=neighbour.id,
            start_ns=start_ns,
            end_ns=end_ns,
            received=len(forward.t_ns),
            power_dbm=forward.power_dbm,
            dropped=dropped,
        )
        try:
            aperture, peer_p_m = self._join(neighbour, forward, start_ns, dropped)
        except ApertureError as error:
            return replace(report, refusal=str(error))
        assert neighbour.session.boot_id is not None
        boot = neighbour.session.boot_id
        return replace(report, aperture=aperture, peer_t_s=aperture.t_s, peer_p_m=peer_p_m, peer_boot=boot)

    def _antenna(self, start_ns: int, end_ns: int) -> tuple[Times, npt.NDArray[np.float64]]:
        """Times (N,) [ns] and positions (N, 3) of our antenna."""
        t_ns, rows = self._poses.between(start_ns, end_ns)
        return t_ns, antenna_positions(rows[:, :3], rows[:, 3:], self._antenna_m)

    def _forward(self, peer: int, start_ns: int, end_ns: int) -> _Forward:
        """Of the grid that most packets of that time have."""
        found = [self._forward_on(heard, start_ns, end_ns) for heard in self._heard.get(peer, {}).values()]
        nothing = _Forward(*(np.zeros(0, np.int64),) * 3, np.zeros((0, SUBCARRIERS, ANTENNAS), np.complex64))
        return max(found, key=lambda forward: len(forward.t_ns), default=nothing)

    def _forward_on(self, heard: Packets, start_ns: int, end_ns: int) -> _Forward:
        stamps = heard.stamps(start_ns - _REMAP_NS, end_ns + _REMAP_NS)
        t_ns = self._times(stamps)
        inside = (t_ns >= start_ns) & (t_ns <= end_ns)
        t_ns, stamps = t_ns[inside], stamps[inside]
        return _Forward(
            t_ns=t_ns,
            frame=stamps[:, FRAME].astype(np.int64),
            nic_us=stamps[:, NIC].astype(np.int64),
            csi=heard.channels(stamps),
            subcarrier_hz=heard.subcarrier_hz,
            half_turns=heard.half_turns,
            power_dbm=_mean_dbm(stamps[:, POWER]),
            band=heard.band,
            fine_us=stamps[:, FINE],
        )

    def _times(self, stamps: npt.NDArray[np.float64]) -> Times:
        t_ns = stamps[:, T].astype(np.int64)
        if self._nic_clock is None or not len(t_ns):
            return t_ns
        again_ns = self._nic_clock.host_ns(stamps[:, NIC].astype(np.uint32))
        # Those before a reset of the card's clock keep the time they had.
        return np.where(np.abs(again_ns - t_ns) < _REMAP_NS // 2, again_ns, t_ns)

    def paired(self, neighbour: Neighbour, start_ns: int, end_ns: int) -> Paired:
        """The exchanges with `neighbour` between two times [ns], wherever the robots were. Raises ApertureError."""
        return self._paired(neighbour, self._forward(neighbour.id, start_ns, end_ns), start_ns)

    def _paired(self, neighbour: Neighbour, forward: _Forward, start_ns: int) -> Paired:
        if not len(forward.t_ns):
            raise ApertureError(f"no packets of {neighbour.name} were heard")
        reverse = neighbour.channels_since(start_ns - _REVERSE_LEAD_NS)
        if len(reverse) and reverse.band != forward.band:
            raise ApertureError(
                f"{neighbour.name} was heard over {name_of(forward.band)} and sends channels of {name_of(reverse.band)}"
            )
        usable = np.flatnonzero(reverse.antenna == _most_common(reverse.antenna))
        if neighbour.counted:
            i, j = pair_by_counter(forward.frame.astype(np.uint32), reverse.frame[usable])
        else:
            i, j = _pair_by_time(neighbour, forward, reverse, usable)
        j = usable[j]
        ours = forward.csi[i, :, strongest_antenna(forward.csi)]
        on = grid_of(forward.band)
        theirs = restore_channel(reverse.coefficients[j], reverse.scale[j], on)
        if forward.fine_us is None or reverse.ticks is None:
            stamps_us = np.stack([forward.nic_us[i], reverse.nic_us[j]], axis=1).astype(np.float64)
            nic_us = np.unwrap(stamps_us, axis=0, period=_NIC_WRAP_US)
        else:
            stamps_us = np.stack([forward.fine_us[i], reverse.ticks[j] / TICKS_PER_US], axis=1)
            nic_us = np.unwrap(stamps_us, axis=0, period=_FINE_WRAP_US)
        wavelength_m = self._wavelength_m
        return Paired(
            i=i,
            j=j,
            reverse=reverse,
            ours=ours,
            theirs=theirs,
            nic_us=nic_us,
            grid=on,
            half_turns=forward.half_turns,
            wavelength_m=wavelength_m if forward.band == OF_5300 else _band_wavelength_m(wavelength_m, on),
        )

    def _join(
        self, neighbour: Neighbour, forward: _Forward, start_ns: int, dropped: dict[str, int]
    ) -> tuple[Aperture, npt.NDArray[np.float64]]:
        """The aperture and the peer's positions (M, 3) at its packets. Raises ApertureError."""
        pairs = self._paired(neighbour, forward, start_ns)
        i, j, reverse, ours, theirs = pairs.i, pairs.j, pairs.reverse, pairs.ours, pairs.theirs
        dropped["unpaired"] = len(forward.t_ns) - len(i)
        if not len(i):
            raise ApertureError(f"none of the {len(forward.t_ns)} packets of {neighbour.name} has its reverse channel")
        of_ours, of_theirs = self._centres.setdefault(neighbour.id, (Centres(), Centres()))
        centre_ours = of_ours.of(forward.nic_us[i], ours, pairs.grid)
        centre_theirs = of_theirs.of(reverse.nic_us[j].astype(np.int64), theirs, pairs.grid)
        t_s = (forward.t_ns[i] - start_ns) / NS_PER_S
        own_t_ns, own_p_m = self._antenna(int(forward.t_ns.min()), int(forward.t_ns.max()))
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
        strong = (np.abs(centre_ours) >= _WEAK_COUNTS) & (np.abs(centre_theirs) >= _WEAK_COUNTS)
        dropped["weak"] = int(np.count_nonzero(~strong))
        dropped["no own pose"] = int(np.count_nonzero(strong & ~own_valid))
        dropped["no neighbour pose"] = int(np.count_nonzero(strong & own_valid & ~their_valid))
        keep = strong & own_valid & their_valid
        aperture = make_aperture(
            t_s[keep],
            p_i_m[keep],
            (centre_ours * centre_theirs)[keep],
            pairs.wavelength_m,
            p_j_m=p_j_m[keep],
            min_packets=self._min_packets,
            forward=ours[keep],
            reverse=theirs[keep],
            nic_us=pairs.nic_us[keep],
            subcarrier_hz=forward.subcarrier_hz,
            half_turns=forward.half_turns,
        )
        return aperture, p_j_m[keep][np.argsort(t_s[keep], kind="stable")]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Paired:
    """Exchanges (K,): rows `i` of our packets and `j` of the reverse channels, both ends' channels (K, S) on `grid`,
    and the stamps (K, 2) of both cards [us], unwrapped."""

    i: npt.NDArray[np.intp]
    j: npt.NDArray[np.intp]
    reverse: wire.CsiBatch
    ours: npt.NDArray[np.complex64]
    theirs: npt.NDArray[np.complex64]
    nic_us: npt.NDArray[np.float64]
    grid: Grid
    half_turns: bool
    wavelength_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Forward:
    """Packets of a neighbour within an aperture: times (N,) [ns], counters, stamps [us], csi (N, S, R) on
    `subcarrier_hz` (S,), None for the 30 of a 5300."""

    t_ns: Times
    frame: Times
    nic_us: Times
    csi: npt.NDArray[np.complex64]
    subcarrier_hz: npt.NDArray[np.float64] | None = None
    half_turns: bool = False
    power_dbm: float = math.nan
    """Mean of their powers."""
    band: int = OF_5300
    fine_us: npt.NDArray[np.float64] | None = None
    """(N,) of the card's fine clock, nan where it has none."""


def _band_wavelength_m(channel_wavelength_m: float, on: Grid) -> float:
    """At the centre of the band that the channel of this wavelength is part of. Raises ApertureError."""
    try:
        return band_wavelength_m(round((SPEED_OF_LIGHT_M_S / channel_wavelength_m - 5e9) / 5e6), on)
    except ValueError as error:
        raise ApertureError(f"csi.channel: {error}") from None


def _pair_by_time(
    neighbour: Neighbour, forward: _Forward, reverse: wire.CsiBatch, usable: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    ours_ns = card_times(forward.nic_us, forward.t_ns)
    theirs_ns = card_times(reverse.nic_us[usable].astype(np.int64), reverse.t_ns[usable])
    lag_ns = neighbour.relation.lag_ns(ours_ns, theirs_ns)
    if lag_ns is None:
        raise ApertureError(
            f"the packets of {neighbour.name} have no counters, and no lag between both series of times stands out"
        )
    return match(ours_ns, theirs_ns, lag_ns)


def _mean_dbm(power_dbm: npt.NDArray[np.float64]) -> float:
    """Of the powers themselves, so that fading does not count twice."""
    return 10 * math.log10(float(np.mean(10 ** (power_dbm / 10)))) if len(power_dbm) else math.nan


def _most_common(antenna: npt.NDArray[np.uint8]) -> int:
    return int(np.bincount(antenna).argmax()) if len(antenna) else 0
