"""CSI records of one card -> the channel of each packet of a known robot, stamped on the host's monotonic clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from companion.core.clock import Clock
from csi_bridge.clock import NicClock
from csi_bridge.feitcsi.channel import thinned
from csi_bridge.feitcsi.parser import parse_record
from csi_bridge.feitcsi.records import FEITCSI_CODE, TICKS_PER_US, FeitRecord
from csi_bridge.parser import channels, parse_head
from csi_bridge.records import CSI_CODE, MPDU_CODE, SUBCARRIERS, CsiError, CsiHead, row_antennas
from csi_bridge.scaling import is_40mhz, total_rss_dbm, without_spatial_mapping
from csi_bridge.source import CsiSource

ANTENNAS = 3


class ChannelSample(NamedTuple):
    """One packet, and its channel of its first transmit antenna; `power_dbm` received over all antennas.

    An Intel 5300's channel stays packed until somebody wants it: most packets are of a vehicle that waits, and many
    at once take little longer than one.
    """

    peer: int
    """Id of the robot that sent the packet."""
    frame: int | None
    """Counter of the exchange; None where the driver gives none (layout 34): such packets are paired by time."""
    t_mono_ns: int
    nic_us: int
    channel: bytes | npt.NDArray[np.complex64]
    """As of `csi`, or the body of the record that holds it, for `packed_channels`."""
    power_dbm: float
    subcarrier_hz: npt.NDArray[np.float64] | None = None
    """(S,) from the channel's centre; None for the 30 of an Intel 5300 at 20 MHz."""
    fine_us: float | None = None
    """When the packet came on the card's fine clock of 3.125 ns, where it has one; wraps every 13.4 s."""
    band: int = 0
    """Format and width of an AX card's packet, bits 8 to 13 of its rate word; 0: an Intel 5300's."""
    half_turns: bool = False
    """Whether the sign of each antenna's channel is random in every packet."""

    @property
    def csi(self) -> npt.NDArray[np.complex64]:
        """(S, R) in counts of the card by antenna A, B, C, zero where a record lacks one of them."""
        return packed_channels([self.channel])[0] if isinstance(self.channel, bytes) else self.channel


@dataclass(slots=True, kw_only=True)
class RadioCounters:
    """What became of the records of a card since the start; owned by `Radio`."""

    records: int = 0
    samples: int = 0
    malformed: int = 0
    unknown_code: int = 0
    unknown_sender: int = 0
    no_sender: int = 0
    """Records of the stock driver, which does not say who sent: nothing can be made of them."""
    wide: int = 0
    """Records of 40 MHz: estimates are made from 20 MHz only."""
    no_counter: int = 0
    """Records of layout 34 and of AX cards, paired by time."""
    lost: int = 0
    """Records the driver counted and we never saw, from gaps in its own 16-bit count: lost on the way, or never
    reported, as a beacon's driver does not report the frames meant for other robots though it counts them."""
    restarts: int = 0
    """Times the driver began anew: its count and its clock went back together."""


class Radio:
    """Drains a CSI source and hands over one `ChannelSample` for each packet of a known peer.

    `peers` maps the six bytes of a MAC to the id of its robot. `on_record` gets every raw record (code, body) for the
    log, before it is parsed, with the time that its card time is mapped by.
    """

    def __init__(
        self,
        *,
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
        self.nic_clock = NicClock()
        self._bfee_count: int | None = None
        self.counters = RadioCounters()
        self._newest: CsiHead | FeitRecord | None = None

    def drain(self) -> int:
        """Takes what waits in the source; how many records that were."""
        records = self._source.arrivals()
        now_ns = self._clock.now_ns()
        for code, body, arrived_ns in records:
            heard_ns = now_ns if arrived_ns is None else min(arrived_ns, now_ns)
            self._on_record(heard_ns, code, body)
            try:
                if code == CSI_CODE:
                    self._take(parse_head(body), body, heard_ns)
                elif code == FEITCSI_CODE:
                    self._take_feitcsi(parse_record(body), heard_ns)
                elif code != MPDU_CODE:
                    self.counters.unknown_code += 1
            except CsiError:
                self.counters.malformed += 1
        return len(records)

    @property
    def rssi_dbm(self) -> tuple[float | None, ...]:
        """Of the newest record, by antenna A, B, C; None where there is no signal."""
        newest = self._newest
        if newest is None:
            return (None,) * ANTENNAS
        if isinstance(newest, CsiHead):
            return tuple(value - 44.0 - newest.agc if value else None for value in newest.rssi)
        return (*(float(power) if power else None for power in newest.rssi_dbm), None)

    def antenna_power(self) -> dict[str, float | None]:
        return dict(zip("ABC", self.rssi_dbm, strict=True))

    def _take(self, record: CsiHead, body: bytes, heard_ns: int) -> None:
        counters = self.counters
        counters.records += 1
        resets = self.nic_clock.resets
        t_mono_ns = self.nic_clock.update(record.timestamp_low_us, heard_ns)
        self._count_losses(record.bfee_count, self.nic_clock.resets != resets)
        self._newest = record
        if record.mac is None:
            counters.no_sender += 1
            return
        peer = self._peers.get(record.mac)
        if peer is None:
            counters.unknown_sender += 1
            return
        if is_40mhz(record.rate):
            counters.wide += 1
            return
        counters.no_counter += record.frame_count is None
        counters.samples += 1
        power_dbm = total_rss_dbm(record.rssi, record.agc)
        self._on_sample(
            ChannelSample(
                peer, record.frame_count, t_mono_ns, record.timestamp_low_us, channel=body, power_dbm=power_dbm
            )
        )

    def _take_feitcsi(self, record: FeitRecord, heard_ns: int) -> None:
        """Such a card counts neither packets nor what it lost."""
        self.counters.records += 1
        resets = self.nic_clock.resets
        t_mono_ns = self.nic_clock.update(record.timestamp_low_us, heard_ns)
        self.counters.restarts += self.nic_clock.resets != resets
        self._newest = record
        peer = self._peers.get(record.mac)
        if peer is None:
            self.counters.unknown_sender += 1
            return
        self.counters.no_counter += 1
        self.counters.samples += 1
        channel, subcarrier_hz = thinned(record)
        self._on_sample(
            ChannelSample(
                peer=peer,
                frame=None,
                t_mono_ns=t_mono_ns,
                nic_us=record.timestamp_low_us,
                channel=_by_power(channel[:, :, 0], record),
                power_dbm=record.power_dbm,
                subcarrier_hz=subcarrier_hz,
                fine_us=record.ftm_ticks / TICKS_PER_US,
                band=record.rate.layout,
                half_turns=True,
            )
        )

    def _count_losses(self, bfee_count: int, clock_reset: bool) -> None:
        if self._bfee_count is not None:
            if clock_reset:
                self.counters.restarts += 1  # the count says nothing of what was lost between
            else:
                self.counters.lost += (bfee_count - self._bfee_count - 1) % 65536
        self._bfee_count = bfee_count


def _by_power(csi: npt.NDArray[np.complex64], record: FeitRecord) -> npt.NDArray[np.complex64]:
    """(S, 2) by antenna. The card reports every chain at one level: what it received is in its power alone."""
    heard = [power if power else -np.inf for power in record.rssi_dbm]
    best = max(heard)
    if record.antennas == (0, 1):
        weaker = heard.index(min(heard))
        if heard[weaker] < best:
            csi = csi.copy()
            csi[:, weaker] *= np.float32(10 ** ((heard[weaker] - best) / 20))
        return csi
    values = np.zeros((len(csi), 2), np.complex64)
    values[:, list(record.antennas)] = csi
    return values


def packed_channels(bodies: Sequence[bytes]) -> npt.NDArray[np.complex64]:
    """Channels (N, 30, 3) as of `ChannelSample.csi` of records whose heads are sound: of the first transmit antenna."""
    csi = np.zeros((len(bodies), SUBCARRIERS, ANTENNAS), np.complex64)
    alike: dict[tuple[int, bytes, bytes], list[int]] = {}
    for row, body in enumerate(bodies):
        alike.setdefault((len(body), body[8:10], body[15:20]), []).append(row)  # antennas; antenna_sel, length, rate
    for rows in alike.values():
        head = parse_head(bodies[rows[0]])
        found = without_spatial_mapping(channels([bodies[row] for row in rows]), head.rate)[..., 0]
        csi[np.ix_(rows, range(SUBCARRIERS), sorted(row_antennas(head.antenna_sel, head.n_rx)))] = found
    return csi
