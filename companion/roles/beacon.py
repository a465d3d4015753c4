"""Role beacon: measures the frames of the flying robot and broadcasts what it measured, with its own poses."""

from __future__ import annotations

import numpy as np

from companion.neighbours.sender import NeighbourSender
from companion.radio.card import ANTENNAS, ChannelSample
from csi_bridge.feitcsi.records import TICKS_PER_US

_SMOOTHING = 0.01  # of each packet in the running power: the choice takes about a hundred packets to change
_HYSTERESIS = 2.0  # another antenna must have twice the power: every change splits the flying robot's aperture


class Beacon:
    """Queues the channel of the strongest antenna of each packet for the next datagram."""

    def __init__(self, sender: NeighbourSender) -> None:
        self._sender = sender
        self._power: list[float] = []
        self._antenna = 0

    def add_sample(self, sample: ChannelSample) -> None:
        csi = sample.csi
        power = [float(np.vdot(column, column).real) for column in csi.T]
        power += [0.0] * (ANTENNAS - len(power))
        smoothing = _SMOOTHING if any(self._power) else 1.0
        self._power = [was + smoothing * (now - was) for was, now in zip(self._power or power, power, strict=True)]
        most = max(self._power)
        if most > _HYSTERESIS * self._power[self._antenna]:
            self._antenna = self._power.index(most)
        self._sender.add_channel(
            sample.frame,
            sample.t_mono_ns,
            sample.nic_us,
            csi[:, self._antenna].copy(),
            power_dbm=sample.power_dbm,
            antenna=self._antenna,
            band=sample.band,
            ticks=0 if sample.fine_us is None else round(sample.fine_us * TICKS_PER_US),
        )
