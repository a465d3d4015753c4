"""The radio link as physics: true motion in, the CSI records of both cards out. No I/O.

The UAV (i) pings, the beacon (j) answers with the same counter about 0.3 ms later. The card of the hearing end reports

    H(k) exp(+-j 2 pi df t) exp(-j 2 pi k 312.5 kHz tau) exp(j const) + noise,    df = f_c (ppm_i - ppm_j) 1e-6

with + at the beacon (transmitter minus receiver) and - at the UAV, the packet's own detection delay tau and time t.
The product of both therefore keeps exp(-j 2 pi df (t_answer - t_ping)), as real captures do. Cards scale a report to a
fixed size whatever its power; the power is in rssi and agc: dBm = 10 log10(sum 10^(rssi / 10)) - 44 - agc.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from companion.sim.draws import ExchangeDraws, exchange_draws
from companion.sim.propagation import SUBCARRIER_INDICES, SUBCARRIER_STEP_HZ, Lattice, carrier_hz, propagate
from companion.sim.scenario import RobotScenario, Scenario
from companion.sim.shadowing import Shadowing
from companion.sim.trajectory import Array, Trajectory
from csi_bridge.records import CsiRecord

Records = tuple[list[CsiRecord], list[CsiRecord]]
R = TypeVar("R")

DEFAULT_EPOCH_NS: Final = 1_700_000_000_000_000_000
_CARD_STREAM: Final = 3
_PING_JITTER: Final = 0.2
_LATEST_ANSWER_S: Final = {"5300": 6e-4, "ax210": 3e-3}
_FULL_SCALE: Final = 30.0
_SCALE_STD: Final = 0.05
_RSSI_TARGET_DB: Final = 37.0
_MAX_AGC: Final = 63
_SELECTIONS: Final = (0b10_01_00, 0b01_10_00)
_RATE: Final = 257
MEAN_DELIVERY_S: Final = 60e-6


@dataclass(frozen=True, slots=True, eq=False)
class Card:
    """One end: what its crystal, its cables and its clocks do. Drawn from the seed where the scenario is silent."""

    robot: RobotScenario
    mac: bytes
    levers_m: Array
    gains: npt.NDArray[np.complex128]
    transmit_phase: complex
    nic_offset_us: float
    bfee_start: int

    @staticmethod
    def make(robot: RobotScenario, seed: int, end: int) -> Card:
        rng = np.random.default_rng([seed, _CARD_STREAM, end])
        phases = rng.uniform(-math.pi, math.pi, 4)
        return Card(
            robot=robot,
            mac=bytes.fromhex(robot.mac.replace(":", "")),
            levers_m=np.array(robot.antennas_m),
            gains=10 ** (np.array(robot.antenna_gain_db) / 20) * np.exp(1j * phases[:3]),
            transmit_phase=complex(np.exp(1j * phases[3])),
            nic_offset_us=float(rng.integers(2**32)),
            bfee_start=int(rng.integers(2**16)),
        )

    def microseconds(self, t_s: Array) -> Array:
        """What its clock stands at, before it wraps."""
        return np.asarray(self.nic_offset_us + (1 + self.robot.oscillator_ppm * 1e-6) * 1e6 * t_s)

    def nic_us(self, t_s: Array) -> npt.NDArray[np.int64]:
        """The card's 32-bit microsecond clock."""
        return np.floor(self.microseconds(t_s)).astype(np.int64) % 2**32


class CardPair(ABC, Generic[R]):
    """Makes the exchanges of a growing span of time. Exchange n is at about n / rate seconds; n starts at 1."""

    _antennas = 3
    lattice: Lattice | None = None
    """Where the card's subcarriers lie; None for the 30 of a 5300."""

    def __init__(self, scenario: Scenario, epoch_ns: int = DEFAULT_EPOCH_NS) -> None:
        """`epoch_ns`: wall time at t = 0, before each robot's own clock offset."""
        self._scenario = scenario
        self._epoch_ns = epoch_ns
        self._uav = Card.make(scenario.uav, scenario.seed, 0)
        self._beacon = Card.make(scenario.beacon, scenario.seed, 1)
        self._df_hz = (
            carrier_hz(scenario.radio.channel) * (scenario.uav.oscillator_ppm - scenario.beacon.oscillator_ppm) * 1e-6
        )
        self._next = 1
        self.heard_s: tuple[Array, Array] = (np.zeros(0), np.zeros(0))
        """When the records of the newest `advance` were received (at the UAV, at the beacon)."""
        phases = (
            self._uav.transmit_phase * self._beacon.gains,
            self._beacon.transmit_phase * self._uav.gains,
        )
        self._shadowing = Shadowing(scenario.seed, scenario.radio.shadowing_db)
        self._constant = 10 ** (scenario.radio.tx_power_dbm / 20) * np.array(phases)[:, : self._antennas]

    @property
    def exchanges(self) -> int:
        """Exchanges made so far, lost ones included."""
        return self._next - 1

    def advance(self, until_s: float, uav: Trajectory, beacon: Trajectory) -> tuple[list[R], list[R]]:
        """Records (at the UAV, at the beacon) of all exchanges that end before `until_s` and were not made yet.

        The trajectories must cover the time since the last call.
        """
        radio = self._scenario.radio
        rate_hz = radio.exchange_rate_hz
        count = math.floor((until_s - _LATEST_ANSWER_S[radio.card]) * rate_hz - _PING_JITTER) - self._next + 1
        if count <= 0:
            self.heard_s = np.zeros(0), np.zeros(0)
            return [], []
        first, self._next = self._next, self._next + count
        draws = exchange_draws(self._scenario.seed, first, count)
        t_s = exchange_times(self._scenario, np.arange(first, first + count), draws)
        signal = self._signal(t_s, uav, beacon, draws, noise=self._noise(first, count, draws))
        at_beacon, at_uav = (self._hear(side, first, t_s[side], signal[side], draws=draws) for side in (0, 1))
        self.heard_s = t_s[1][~self._is_lost(draws, 1)], t_s[0][~self._is_lost(draws, 0)]
        return at_uav, at_beacon

    def _is_lost(self, draws: ExchangeDraws, side: int) -> npt.NDArray[np.bool_]:
        """Of each exchange, whether the card on this side missed its packet."""
        return np.asarray(draws.uniforms[:, 3 + side] < self._scenario.radio.loss_probability)

    def skip_to(self, from_s: float) -> None:
        """Leaves out the exchanges before `from_s`."""
        self._next = max(self._next, math.ceil(from_s * self._scenario.radio.exchange_rate_hz + 1))

    @abstractmethod
    def _noise(self, first: int, count: int, draws: ExchangeDraws) -> npt.NDArray[np.complexfloating]:
        """(N, 2, S, R) in sqrt(mW)."""

    @abstractmethod
    def _hear(
        self, side: int, first: int, t_s: Array, signal: npt.NDArray[np.complex128], *, draws: ExchangeDraws
    ) -> list[R]:
        """Records of one card from signal (N, S, R); side 0 is the beacon hearing pings, 1 the UAV hearing answers."""

    def _ends(self, side: int) -> tuple[Card, Card]:
        """Sender and receiver."""
        return (self._uav, self._beacon) if side == 0 else (self._beacon, self._uav)

    def _signal(
        self,
        t_s: Array,
        uav: Trajectory,
        beacon: Trajectory,
        draws: ExchangeDraws,
        *,
        noise: npt.NDArray[np.complexfloating],
    ) -> npt.NDArray[np.complex128]:
        """What the cards estimate, (2, N, S, R) in sqrt(mW): at the beacon at t_s[0], at the UAV at t_s[1]."""
        radio = self._scenario.radio
        ends_m = [
            robot.antennas_at(t_s.ravel(), card.levers_m[: self._antennas]).reshape(2, -1, self._antennas, 3)
            for robot, card in ((uav, self._uav), (beacon, self._beacon))
        ]
        channel = propagate(
            np.concatenate([ends_m[0][0, :, 0], ends_m[1][1, :, 0]]),
            np.concatenate([ends_m[1][0], ends_m[0][1]]),
            radio,
            self.lattice,
        )
        if radio.shadowing_db:
            channel *= np.tile(self._shadowing.gain(ends_m[0][0, :, 0], ends_m[1][0, :, 0]), 2)[:, None, None]
        delay_s = radio.detection_delay_s + radio.detection_delay_std_s * draws.normals[:, 1:3].T
        turns = self._df_hz * np.array([[1.0], [-1.0]]) * t_s
        hz = SUBCARRIER_STEP_HZ * SUBCARRIER_INDICES if self.lattice is None else self.lattice.hz
        phase = turns[..., None] - hz * delay_s[..., None]
        noise = noise.swapaxes(0, 1)
        signal: npt.NDArray[np.complex128] = channel.reshape(noise.shape)
        signal *= np.exp(2j * math.pi * phase)[..., None]
        signal *= self._constant[:, None, None, :]
        signal += noise
        return signal


class RadioLink(CardPair[CsiRecord]):
    """Both cards are Intel 5300."""

    def __init__(self, scenario: Scenario, epoch_ns: int = DEFAULT_EPOCH_NS) -> None:
        super().__init__(scenario, epoch_ns)
        # By hearing side: 0 the beacon, 1 the UAV.
        self._counts = [self._beacon.bfee_start, self._uav.bfee_start]

    def _noise(self, first: int, count: int, draws: ExchangeDraws) -> npt.NDArray[np.complexfloating]:
        return np.asarray(10 ** (self._scenario.radio.noise_dbm / 20) * draws.noise)

    def _hear(
        self, side: int, first: int, t_s: Array, signal: npt.NDArray[np.complex128], *, draws: ExchangeDraws
    ) -> list[CsiRecord]:
        sender, receiver = self._ends(side)
        power_mw = np.sum(signal.real**2 + signal.imag**2, axis=1) / signal.shape[1]
        power_dbm = 10 * np.log10(power_mw)
        agc = np.minimum(np.maximum(np.rint(_RSSI_TARGET_DB - 44 - power_dbm.max(axis=1)), 0), _MAX_AGC)
        rssi = np.minimum(np.maximum(np.rint(power_dbm + 44 + agc[:, None]), 1), 255).astype(int).tolist()
        csi = _quantise(signal, power_mw, draws.normals[:, 3 + side])
        nic_us = receiver.nic_us(t_s).tolist()
        host_s = t_s + MEAN_DELIVERY_S * draws.delivery[:, side] + receiver.robot.clock_offset_s
        host_us = np.rint(host_s * 1e6).astype(np.int64).tolist()
        selection = draws.uniforms[:, 5 + side].tolist()
        records = []
        for i, is_lost in enumerate(self._is_lost(draws, side).tolist()):
            if is_lost:
                continue
            self._counts[side] = (self._counts[side] + 1) & 0xFFFF
            records.append(
                CsiRecord(
                    timestamp_low_us=nic_us[i],
                    bfee_count=self._counts[side],
                    n_rx=csi.shape[2],
                    n_tx=1,
                    rssi=tuple(rssi[i]),
                    noise_dbm=round(self._scenario.radio.noise_dbm),
                    agc=int(agc[i]),
                    antenna_sel=_SELECTIONS[int(selection[i] * len(_SELECTIONS))],
                    rate=_RATE,
                    csi=csi[i, :, :, None],
                    layout=38,
                    host_time_ns=self._epoch_ns + host_us[i] * 1000,
                    mac=sender.mac,
                    frame_count=(first + i) & 0xFFFFFFFF,
                )
            )
        return records


def simulate_exchanges(scenario: Scenario, uav: Trajectory, beacon: Trajectory) -> Records:
    """Records (at the UAV, at the beacon) of the exchanges within the UAV's samples; both trajectories start at t >= 0.

    Pure: the same arguments give the same records.
    """
    link = RadioLink(scenario)
    link.skip_to(float(uav.t_s[0]))
    return link.advance(float(uav.t_s[-1]), uav, beacon)


def exchange_times(scenario: Scenario, counters: npt.NDArray[np.int64], draws: ExchangeDraws) -> Array:
    """True times [s] of consecutive exchanges `counters` (N,) with their `draws`: (2, N), pings and answers."""
    radio = scenario.radio
    outlier = draws.uniforms[:, 1] < radio.turnaround_outlier_probability
    late_s = np.where(outlier, radio.turnaround_outlier_s * (0.5 + draws.uniforms[:, 2]), 0.0)
    turnaround_s = radio.turnaround_s + radio.turnaround_jitter_s * draws.normals[:, 0] + late_s
    t_s = np.empty((2, len(counters)))
    t_s[0] = (counters + _PING_JITTER * draws.uniforms[:, 0]) / radio.exchange_rate_hz
    t_s[1] = t_s[0] + np.minimum(np.maximum(turnaround_s, 1e-6), _LATEST_ANSWER_S[radio.card])
    return t_s


def _quantise(signal: npt.NDArray[np.complex128], power_mw: Array, scale: Array) -> npt.NDArray[np.complex64]:
    """The card's int8 report: the strongest antenna at about 30 counts, the others in proportion."""
    size = _FULL_SCALE * np.minimum(np.maximum(1 + _SCALE_STD * scale, 0.8), 1.2)
    parts = np.rint((signal * (size / np.sqrt(power_mw.max(axis=1)))[:, None, None]).view(np.float64))
    csi: npt.NDArray[np.complex64] = np.minimum(np.maximum(parts, -128), 127).astype(np.float32).view(np.complex64)
    return csi
