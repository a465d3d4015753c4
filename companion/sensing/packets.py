"""The packets of one peer over one grid of subcarriers, whose channels stay packed until an aperture is cut of them."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from companion.radio.card import ChannelSample, packed_channels
from companion.sensing.history import History

FRAME, NIC, T, POWER, FINE = 0, 1, 2, 3, 4
"""Columns of a packet's stamps: counter, card's stamp [us], time [ns], power [dBm], fine stamp [us]."""
_NUMBER: Final = 5
_NO_FRAME: Final = -1


class Packets:
    """The newest `capacity`, in the order they came in; `like` is one of them."""

    def __init__(self, like: ChannelSample, capacity: int) -> None:
        self.shape = like.csi.shape
        self.subcarrier_hz = like.subcarrier_hz
        self.half_turns, self.band = like.half_turns, like.band
        self._capacity = capacity
        self._stamps = History(capacity, _NUMBER + 1)
        self._count = 0
        # By number of the packet, modulo the capacity. Half precision keeps a 5300's whole numbers exactly.
        self._channels = np.zeros((capacity, 2 * math.prod(self.shape)), np.float16)
        self._packed: list[bytes | None] = [None] * capacity

    def add(self, sample: ChannelSample) -> None:
        at, channel, newest_ns = self._count % self._capacity, sample.channel, self._stamps.newest_ns
        if isinstance(channel, bytes):
            self._packed[at] = channel
        else:
            self._packed[at] = None
            self._channels[at] = _parts(channel)
        t_ns = sample.t_mono_ns
        self._stamps.append(
            # The mapped times of a young clock relation may step back a little.
            t_ns if newest_ns is None or t_ns > newest_ns else newest_ns,
            (
                _NO_FRAME if sample.frame is None else sample.frame,
                sample.nic_us,
                t_ns,
                sample.power_dbm,
                math.nan if sample.fine_us is None else sample.fine_us,
                self._count,
            ),
        )
        self._count += 1

    def stamps(self, start_ns: int, end_ns: int) -> npt.NDArray[np.float64]:
        """Rows (N, 6), as `History.between` chooses them; the last column is for `channels`."""
        return self._stamps.between(start_ns, end_ns)[1]

    def channels(self, stamps: npt.NDArray[np.float64]) -> npt.NDArray[np.complex64]:
        """Channels (N, S, R) of rows of stamps, taken since the last packet was added."""
        rows = stamps[:, _NUMBER].astype(np.int64) % self._capacity
        packed = [row for row in rows.tolist() if self._packed[row] is not None]
        if packed:
            bodies = [body for row in packed if (body := self._packed[row]) is not None]
            self._channels[packed] = _parts(packed_channels(bodies))
            for row in packed:
                self._packed[row] = None
        found = self._channels[rows].astype(np.float32).view(np.complex64)
        return found.reshape(-1, *self.shape)


def _parts(channels: npt.NDArray[np.complex64]) -> npt.NDArray[Any]:
    """Real and imaginary parts, all of one packet in a row."""
    rows = channels if channels.ndim == 3 else channels[np.newaxis]
    return np.ascontiguousarray(rows).view(np.float32).reshape(len(rows), -1)
