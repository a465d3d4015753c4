"""A simulated radio link for the studies: the simulator's cards and rooms, along any two paths of the antennas.

The channel is that of `companion.sim`: reflections, 30 subcarriers, turnaround jitter, detection delays, oscillator and
clock offsets, noise and int8 reports. The antenna sits on the path itself, so no lever arm comes in.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from numpy.random import SeedSequence

from companion.analysis.by_time import pair_by_card_time
from companion.sim.ax_radio import simulate_ax_exchanges
from companion.sim.propagation import carrier_hz
from companion.sim.radio import DEFAULT_EPOCH_NS, simulate_exchanges
from companion.sim.scenario import RadioScenario, Scenario, bare_robot
from companion.sim.scenes import hall
from companion.sim.trajectory import Trajectory
from csi_bridge.clock import host_times_s
from csi_bridge.feitcsi.channel import thinned
from csi_bridge.feitcsi.clock import fine_us
from csi_bridge.feitcsi.records import FeitRecord
from csi_bridge.records import CsiRecord
from wsr.aperture import Aperture, make_aperture
from wsr.channel import SPEED_OF_LIGHT_M_S, centre_channel, pair_by_counter
from wsr.ofdm import Grid, grid
from wsr.reduced import as_sent

Array = npt.NDArray[np.float64]

CLOCK_OFFSET_S = 38.0
"""Of the ground robot's host clock, as in the recordings."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Heard:
    """K exchanges that both ends recorded: times (K,) on our clock and on the other's own, channels (K, S) of both
    directions, stamps (K, 2) of both cards."""

    t_s: Array
    other_t_s: Array
    forward: npt.NDArray[np.complex64]
    reverse: npt.NDArray[np.complex64]
    nic_us: Array
    carrier_hz: float
    grid: Grid | None = None
    """Of AX cards, whose chains turn by half a turn at random; None: 30 subcarriers of a 5300."""

    def aperture(
        self, p_i_m: Array, p_j_m: Array | None = None, keep: npt.NDArray[np.bool_] | None = None, min_packets: int = 20
    ) -> Aperture:
        """With antenna positions (K, 3) as each robot believes them. Raises ApertureError."""
        chosen = np.ones(self.t_s.size, np.bool_) if keep is None else keep
        forward, reverse = self.forward[chosen], self.reverse[chosen]
        return make_aperture(
            self.t_s[chosen],
            p_i_m[chosen],
            centre_channel(forward, self.grid) * centre_channel(reverse, self.grid),
            SPEED_OF_LIGHT_M_S / self.carrier_hz,
            p_j_m=None if p_j_m is None else p_j_m[chosen],
            min_packets=min_packets,
            forward=forward,
            reverse=reverse,
            nic_us=self.nic_us[chosen],
            subcarrier_hz=None if self.grid is None else self.grid.hz,
            half_turns=self.grid is not None,
        )


def room(
    rng: np.random.Generator, ends_m: npt.ArrayLike, radio: RadioScenario | None = None, occluded: bool = False
) -> RadioScenario:
    """A hall around both robots, whose places are `ends_m` (N, 3).

    Occluded: something takes 10 dB off the direct path, the walls reflect as before.
    """
    base = RadioScenario() if radio is None else radio
    return replace(base, reflectors=hall(rng, ends_m).reflectors, direct_gain=0.32 if occluded else 1.0)


def scenario(seed: SeedSequence, radio: RadioScenario) -> Scenario:
    """Two robots with cards of random crystals; antennas on the tracked points. Nothing here opens a socket."""
    rng = np.random.default_rng(seed.spawn(1)[0])
    ppm = rng.uniform(-2.0, 2.0, 2)

    return Scenario(
        seed=int(seed.generate_state(1)[0]),
        uav=bare_robot("uav", "00:21:6A:00:00:01", float(ppm[0]), 0.0),
        beacon=bare_robot("beacon", "00:21:6A:00:00:02", float(ppm[1]), CLOCK_OFFSET_S),
        truth_in="none",
        truth_out="none",
        radio=radio,
    )


def hear(world: Scenario, uav: Trajectory, beacon: Trajectory) -> Heard:
    """The exchanges along two true trajectories, paired by their counters as on a real link."""
    at_uav, at_beacon = simulate_exchanges(world, uav, beacon)
    i, j = pair_by_counter(_counters(at_uav), _counters(at_beacon))
    ours, theirs = [at_uav[k] for k in i], [at_beacon[k] for k in j]
    stamps = np.array([[a.timestamp_low_us, b.timestamp_low_us] for a, b in zip(ours, theirs, strict=True)], float)
    return Heard(
        t_s=_host_s(ours),
        other_t_s=_host_s(theirs),
        forward=_csi(ours),
        reverse=_csi(theirs),
        nic_us=np.unwrap(stamps, axis=0, period=float(1 << 32)),
        carrier_hz=carrier_hz(world.radio.channel),
    )


def hear_ax(world: Scenario, uav: Trajectory, beacon: Trajectory) -> Heard:
    """The same of two AX cards, paired by their own clocks; the reverse channel as a datagram would bring it."""
    ends = simulate_ax_exchanges(world, uav, beacon, host_stamps=True)
    fine = [_fine_us(records) for records in ends]
    pairs = pair_by_card_time(*fine)
    chosen = [[records[k] for k in pair] for records, pair in zip(ends, pairs, strict=True)]
    heard = [[thinned(record) for record in records] for records in chosen]
    on = grid(heard[0][0][1])
    forward, reverse = (np.array([csi[:, 0, 0] for csi, _ in side], np.complex64) for side in heard)
    return Heard(
        t_s=_ax_host_s(chosen[0]),
        other_t_s=_ax_host_s(chosen[1]),
        forward=forward,
        reverse=as_sent(reverse, on),
        nic_us=np.stack([times[pair] for times, pair in zip(fine, pairs, strict=True)], axis=1),
        carrier_hz=carrier_hz(world.radio.channel),
        grid=on,
    )


def trajectory(points_m: Array, speed_m_s: float, start_s: float = 1.0) -> Trajectory:
    """Flown along a polyline (N, 3) at constant speed, nose to the East."""
    steps = np.linalg.norm(np.diff(points_m, axis=0), axis=1)
    t_s = start_s + np.concatenate([[0.0], np.cumsum(steps)]) / speed_m_s
    return Trajectory(t_s, points_m, np.zeros(len(points_m)))


def standing(point_m: Array, start_s: float, end_s: float) -> Trajectory:
    """At one place."""
    return Trajectory(np.array([start_s, end_s]), np.array([point_m, point_m]), np.zeros(2))


def _counters(records: list[CsiRecord]) -> npt.NDArray[np.int64]:
    return np.array([record.frame_count for record in records], np.int64)


def _host_s(records: list[CsiRecord]) -> Array:
    return np.array([(record.host_time_ns or 0) - DEFAULT_EPOCH_NS for record in records], np.float64) * 1e-9


def _fine_us(records: list[FeitRecord]) -> Array:
    ticks = np.array([record.ftm_ticks for record in records], np.uint32)
    return fine_us(ticks, np.array([record.timestamp_low_us for record in records], np.uint32))


def _ax_host_s(records: list[FeitRecord]) -> Array:
    host_s = np.array([record.host_time_us for record in records], np.float64) * 1e-6 - DEFAULT_EPOCH_NS * 1e-9
    return host_times_s(np.array([record.timestamp_low_us for record in records], np.uint32), host_s)


def _csi(records: list[CsiRecord]) -> npt.NDArray[np.complex64]:
    """(K, 30) of antenna A, which alone carries signal, wherever the card put it."""
    return np.array([record.csi[:, record.antennas.index(0), 0] for record in records], np.complex64)
