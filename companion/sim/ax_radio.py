"""The radio link of two AX cards with FeitCSI: what differs from `companion.sim.radio`.

The propagation, crystals and delays are the same. A record holds one HE packet over 20 to 160 MHz on two chains, each
scaled by itself and with a random sign; the conjugate is reported, pilots are zero, and at 160 MHz the card fades to an
eighth at two places (docs/cards.md). There is no frame counter, and the answer comes from user space.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.sim.draws import ExchangeDraws
from companion.sim.propagation import Lattice
from companion.sim.radio import DEFAULT_EPOCH_NS, MEAN_DELIVERY_S, CardPair
from companion.sim.scenario import Scenario
from companion.sim.trajectory import Array, Trajectory
from csi_bridge.feitcsi.rate import Format, Rate
from csi_bridge.feitcsi.records import HEADER_BYTES, TICKS_PER_US, FeitRecord
from csi_bridge.feitcsi.tones import Tones, tones

AxRecords = tuple[list[FeitRecord], list[FeitRecord]]

_CARD_STREAM: Final = 11
_NOISE_STREAM: Final = 12
_BLOCK: Final = 64
_CHAINS: Final = 2
_WIDTHS_MHZ: Final = (20, 40, 80, 160)
_BASE_MHZ: Final = 20
_LEVEL: Final = 150.0
"""Mean amplitude of every chain, as in the captures, whatever it receives."""
_LEVEL_STD: Final = 0.02
_MOST: Final = (1 << 15) - 1
_FADED: Final = 0.125
_LEAST_DBM: Final = -120.0


class AxRadioLink(CardPair[FeitRecord]):
    """Both cards are AX200 or AX210."""

    _antennas = _CHAINS

    def __init__(self, scenario: Scenario, epoch_ns: int = DEFAULT_EPOCH_NS, host_stamps: bool = False) -> None:
        """`host_stamps`: as a logger writes that knows the host's time; the driver leaves it zero."""
        super().__init__(scenario, epoch_ns)
        self._host_stamps = host_stamps
        width_mhz = scenario.radio.width_mhz
        plan = tones(Format.HE, width_mhz)
        assert plan is not None
        self._plan: Tones = plan
        self.lattice = Lattice(plan.index, plan.spacing_hz)
        self._rate = Rate(Format.HE << 8 | _WIDTHS_MHZ.index(width_mhz) << 11 | 0b11 << 14)
        pilots = ~plan.valid
        # Pilots and the two places where the firmware fades are marked alike; only the pilots report nothing.
        hollow = pilots & (np.abs(np.abs(plan.index * plan.spacing_hz) - 60e6) <= 2.5 * plan.spacing_hz)
        self._passes = np.where(hollow, _FADED, np.where(pilots, 0.0, 1.0)) if width_mhz == 160 else ~pilots * 1.0
        self._noise_mw = 10 ** (scenario.radio.noise_dbm / 10) * width_mhz / _BASE_MHZ
        rng = np.random.default_rng([scenario.seed, _CARD_STREAM])
        self._fine_offsets = rng.integers(2**32, size=2)

    def _noise(self, first: int, count: int, draws: ExchangeDraws) -> npt.NDArray[np.complexfloating]:
        last = first + count - 1
        size = len(self._plan.index)
        parts = [
            _noise_block(self._scenario.seed, number, size)[
                max(first - number * _BLOCK, 0) : last - number * _BLOCK + 1
            ]
            for number in range(first // _BLOCK, last // _BLOCK + 1)
        ]
        return np.asarray(np.float32(math.sqrt(self._noise_mw)) * np.concatenate(parts))

    def _hear(
        self, side: int, first: int, t_s: Array, signal: npt.NDArray[np.complex128], *, draws: ExchangeDraws
    ) -> list[FeitRecord]:
        sender, receiver = self._ends(side)
        microseconds = receiver.microseconds(t_s)
        nic_us = np.floor(microseconds).astype(np.int64) % 2**32
        ticks = (np.floor(microseconds * TICKS_PER_US).astype(np.int64) + self._fine_offsets[side]) % 2**32
        host_us = np.zeros(len(t_s), np.int64)
        if self._host_stamps:
            host_s = t_s + MEAN_DELIVERY_S * draws.delivery[:, side] + receiver.robot.clock_offset_s
            host_us = self._epoch_ns // 1000 + np.rint(host_s * 1e6).astype(np.int64)
        power_mw = np.mean(np.square(np.abs(signal)), axis=1)
        dbm = np.rint(np.maximum(10 * np.log10(power_mw), _LEAST_DBM)).astype(int)
        level = _LEVEL * (1 + _LEVEL_STD * np.clip(draws.normals[:, 3 + side], -3, 3))[:, None]
        level = level * _signs(self._scenario.seed, side, first, len(t_s)) / np.sqrt(power_mw)
        parts = np.rint((np.conj(signal) * level[:, None] * self._passes[:, None]).view(np.float64))
        csi = np.clip(parts, -_MOST, _MOST).astype(np.float32).view(np.complex64)
        return [
            FeitRecord(
                ftm_ticks=int(ticks[i]),
                host_time_us=int(host_us[i]),
                rssi_dbm=(int(min(dbm[i, 0], -1)), int(min(dbm[i, 1], -1))),
                mac=sender.mac,
                timestamp_low_us=int(nic_us[i]),
                rate=self._rate,
                csi=csi[i, :, :, None],
                header=bytes(HEADER_BYTES),
            )
            for i, is_lost in enumerate(self._is_lost(draws, side).tolist())
            if not is_lost
        ]


def simulate_ax_exchanges(
    scenario: Scenario, uav: Trajectory, beacon: Trajectory, host_stamps: bool = False
) -> AxRecords:
    """Records (at the UAV, at the beacon) of the exchanges within the UAV's samples; both trajectories start at t >= 0.

    Pure: the same arguments give the same records.
    """
    link = AxRadioLink(scenario, host_stamps=host_stamps)
    link.skip_to(float(uav.t_s[0]))
    return link.advance(float(uav.t_s[-1]), uav, beacon)


def _signs(seed: int, side: int, first: int, count: int) -> Array:
    """(N, 2) of +-1, of the exchanges from `first` on."""
    blocks = [_sign_block(seed, number) for number in range(first // _BLOCK, (first + count - 1) // _BLOCK + 1)]
    return np.concatenate(blocks)[first % _BLOCK :][:count, side]


@lru_cache(maxsize=4)
def _sign_block(seed: int, number: int) -> Array:
    """(_BLOCK, 2, 2) by exchange, side and chain."""
    rng = np.random.default_rng([seed, _CARD_STREAM, number])
    return rng.choice([-1.0, 1.0], (_BLOCK, 2, _CHAINS))


@lru_cache(maxsize=4)
def _noise_block(seed: int, number: int, size: int) -> npt.NDArray[np.complex64]:
    """(_BLOCK, 2, S, 2): complex normal of variance 1."""
    rng = np.random.default_rng([seed, _NOISE_STREAM, number])
    parts = rng.standard_normal((_BLOCK, 2, size, _CHAINS, 2), np.float32) * np.float32(math.sqrt(0.5))
    return parts.view(np.complex64)[..., 0]
