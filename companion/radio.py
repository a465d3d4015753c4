"""CSI records of one card -> one complex value per packet and antenna, stamped on the host's monotonic clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from companion.clock import Clock
from csi_bridge.clock import NicClock
from csi_bridge.parser import parse_body
from csi_bridge.records import CsiError, CsiRecord
from csi_bridge.source import CsiSource
from wsr.channel import centre_channel

ANTENNAS = 3


@dataclass(frozen=True, slots=True, eq=False)
class ChannelSample:
    """The channel of one packet at the true channel centre.

    `values` (3,) complex64 by antenna A, B, C, zero where the card has none; only the first transmit stream is used.
    """

    peer: int
    """Id of the robot that sent the packet."""
    frame: int
    """Counter of the exchange."""
    t_mono_ns: int
    nic_us: int
    values: npt.NDArray[np.complex64]


@dataclass(slots=True)
class RadioCounters:
    """What became of the records of a card since the start; owned by `Radio`."""

    records: int = 0
    samples: int = 0
    malformed: int = 0
    unknown_sender: int = 0
    no_counter: int = 0
    """Records of layouts without a frame counter: they cannot be paired live."""
    lost: int = 0
    """Records the card made and we never saw, from gaps in its own 16-bit count."""


class Radio:
    """Drains a CSI source and hands over one `ChannelSample` for each packet of a known peer.

    `peers` maps the six bytes of a MAC to the id of its robot. `on_record` gets every raw record (code, body) for the
    log, before it is parsed.
    """

    def __init__(
        self,
        source: CsiSource,
        peers: Mapping[bytes, int],
        clock: Clock,
        on_sample: Callable[[ChannelSample], None],
        on_record: Callable[[int, int, bytes], None],
    ) -> None:
        self._source = source
        self._peers = peers
        self._clock = clock
        self._on_sample = on_sample
        self._on_record = on_record
        self._nic_clock = NicClock()
        self._bfee_count: int | None = None
        self.counters = RadioCounters()

    def drain(self) -> None:
        """Called when the source is readable."""
        bodies = self._source.drain()
        now_ns = self._clock.now_ns()
        for code, body in bodies:
            self._on_record(now_ns, code, body)
            try:
                record = parse_body(code, body)
            except CsiError:
                self.counters.malformed += 1
                continue
            if isinstance(record, CsiRecord):
                self._take(record, now_ns)

    def _take(self, record: CsiRecord, now_ns: int) -> None:
        self.counters.records += 1
        self._count_losses(record.bfee_count)
        t_mono_ns = self._nic_clock.update(record.timestamp_low_us, now_ns)
        if record.mac is None or record.frame_count is None:
            self.counters.no_counter += 1
            return
        peer = self._peers.get(record.mac)
        if peer is None:
            self.counters.unknown_sender += 1
            return
        values = np.zeros(ANTENNAS, np.complex64)
        values[list(record.antennas)] = centre_channel(record.csi[:, :, 0].T)
        self.counters.samples += 1
        self._on_sample(ChannelSample(peer, record.frame_count, t_mono_ns, record.timestamp_low_us, values))

    def _count_losses(self, bfee_count: int) -> None:
        if self._bfee_count is not None:
            self.counters.lost += (bfee_count - self._bfee_count - 1) % 65536
        self._bfee_count = bfee_count
