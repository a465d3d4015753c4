"""Role beacon: measures the frames of the flying robot and broadcasts what it measured, with its own poses."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from companion.neighbours import NeighbourSender
from companion.radio import ANTENNAS, ChannelSample

_SMOOTHING = 0.01  # of each packet in the running power: the choice takes about a hundred packets to change
_HYSTERESIS = 2.0  # another antenna must have twice the power: every change splits the flying robot's aperture


class Beacon:
    """Reduces each record to the value of its strongest antenna and queues it for the next datagram."""

    def __init__(self, sender: NeighbourSender) -> None:
        self._sender = sender
        self._power: npt.NDArray[np.float64] = np.zeros(ANTENNAS)
        self._antenna = 0

    def add_sample(self, sample: ChannelSample) -> None:
        power = np.square(np.abs(sample.values.astype(np.complex128)))
        self._power += (power - self._power) * (_SMOOTHING if self._power.any() else 1.0)
        best = int(self._power.argmax())
        if self._power[best] > _HYSTERESIS * self._power[self._antenna]:
            self._antenna = best
        value = complex(sample.values[self._antenna])
        self._sender.add_channel(sample.frame, sample.t_mono_ns, sample.nic_us, value, self._antenna)
