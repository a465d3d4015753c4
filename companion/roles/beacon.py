"""Role beacon: measures the frames of the flying robot and broadcasts what it measured, with its own poses."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.neighbours.sender import NeighbourSender
from companion.radio.card import ANTENNAS, ChannelSample
from csi_bridge.feitcsi.records import TICKS_PER_US

_SMOOTHING = 0.01  # of each packet in the running power: the choice takes about a hundred packets to change
_HYSTERESIS = 2.0  # another antenna must have twice the power: every change splits the flying robot's aperture


class Beacon:
    """Queues the channel of the strongest antenna of each packet for the next datagram."""

    def __init__(self, sender: NeighbourSender) -> None:
        self._sender = sender
        self._power: npt.NDArray[np.float32] = np.zeros(ANTENNAS, np.float32)
        self._antenna = 0

    def add_sample(self, sample: ChannelSample) -> None:
        csi = sample.csi
        power = np.einsum("sa,sa->a", csi, csi.conj()).real
        power = np.pad(power, (0, ANTENNAS - len(power)))
        self._power += (power - self._power) * (_SMOOTHING if self._power.any() else 1.0)
        best = int(self._power.argmax())
        if self._power[best] > _HYSTERESIS * self._power[self._antenna]:
            self._antenna = best
        self._sender.add_channel(
            sample.frame,
            sample.t_mono_ns,
            sample.nic_us,
            csi[:, self._antenna].copy(),
            sample.power_dbm,
            self._antenna,
            sample.band,
            0 if sample.fine_us is None else round(sample.fine_us * TICKS_PER_US),
        )
