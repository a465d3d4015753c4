"""The radio's own faults through the real kernel path: flood (12), silence (13), restart of the driver (15)."""

from __future__ import annotations

import dataclasses

import pytest

from companion.clock import NS_PER_S, ManualClock
from companion.conditions import conditions
from companion.mission import Event, State
from companion.radio import ChannelSample, Radio
from csi_bridge.encoder import encode_body
from csi_bridge.netlink import NetlinkFeeder, NetlinkSource, connector_available
from csi_bridge.records import CSI_CODE, CsiRecord
from tests.csi_records import MAC, record
from tests.faults.figures import record as note
from tests.unit.test_conditions import LIMITS, QUIET

IDX = 18
UNAVAILABLE = connector_available(IDX)
needs_netlink = pytest.mark.skipif(UNAVAILABLE is not None, reason=f"netlink connector: {UNAVAILABLE}")


class Card:
    """A driver that counts and stamps, and a service's radio behind the real connector."""

    def __init__(self, receive_buffer_bytes: int = 1 << 20) -> None:
        self.clock = ManualClock(1000 * NS_PER_S)
        self.source = NetlinkSource(IDX, require_kernel_sender=False, receive_buffer_bytes=receive_buffer_bytes)
        self.feeder = NetlinkFeeder(IDX)
        self.samples: list[ChannelSample] = []
        self.radio = Radio(self.source, {MAC: 2}, self.clock, self.samples.append, lambda *_: None)
        self.count = 65_000  # wraps soon
        self.stamp_us = 4_294_000_000

    def send(self, records: int, period_s: float = 0.005, drained: bool = True) -> None:
        plain = record()
        for _ in range(records):
            self.clock.advance(period_s)
            self.count = (self.count + 1) & 0xFFFF
            self.stamp_us = (self.stamp_us + round(period_s * 1e6)) % (1 << 32)
            self.feeder.send(CSI_CODE, encode_body(self._stamped(plain)))
            if drained:
                self.radio.drain()

    def restart(self) -> None:
        self.count, self.stamp_us = 0, 17

    def close(self) -> None:
        self.feeder.close()
        self.source.close()

    def _stamped(self, plain: CsiRecord) -> CsiRecord:
        return dataclasses.replace(plain, bfee_count=self.count, timestamp_low_us=self.stamp_us)


@needs_netlink
def test_fault_12_a_flood_is_survived_and_its_loss_counted_exactly_across_the_wrap() -> None:
    card = Card(receive_buffer_bytes=64 << 10)
    card.send(100)
    sent = 3000
    card.send(sent, period_s=0.0005, drained=False)
    before = len(card.samples)
    while len(card.samples) > before or card.source.counters.overruns == 0:
        before = len(card.samples)
        card.radio.drain()
    card.send(1)  # the first that comes through shows what was lost
    lost = card.radio.counters.lost
    assert card.source.counters.overruns >= 1
    assert lost == 100 + sent + 1 - len(card.samples)
    assert 0 < lost < sent
    card.send(50)
    assert len(card.samples) + lost == 100 + sent + 51
    note(12, "flood over the socket buffer", sent=sent, lost=lost, counted=card.radio.counters.lost)
    card.close()


@needs_netlink
def test_fault_15_a_restarted_driver_is_back_at_once() -> None:
    card = Card()
    card.send(400)
    card.clock.advance(3.0)
    card.restart()
    start_ns, before = card.clock.now_ns(), len(card.samples)
    card.send(200)
    back_s = (card.samples[before].t_mono_ns - start_ns) / NS_PER_S
    assert len(card.samples) == before + 200
    assert card.radio.nic_clock.resets == 1
    assert card.radio.counters.restarts == 1
    assert card.radio.counters.lost == 0  # a count from zero says nothing of records between
    assert 0 < back_s <= 2.0
    late_ns = [abs(s.t_mono_ns - start_ns - (i + 1) * 5_000_000) for i, s in enumerate(card.samples[before:])]
    assert max(late_ns) < 200_000
    note(15, "driver restarts", back_after_s=back_s, records_missed=0)
    card.close()


@pytest.mark.parametrize("state", [State.ACQUIRING, State.APPROACHING])
def test_fault_13_two_seconds_of_silence_are_a_stale_bearing(state: State) -> None:
    def events(silent_s: float) -> list[Event]:
        return conditions(state, dataclasses.replace(QUIET, target_age_s=silent_s), LIMITS)

    assert Event.BEARING_STALE not in events(1.9)
    assert Event.BEARING_STALE in events(2.1)
    note(13, f"CSI silent while {state}", stale_after_s=2.0)


def test_layout_34_and_40_mhz_and_stock_records_are_told_apart() -> None:
    clock, samples = ManualClock(NS_PER_S), list[ChannelSample]()

    class Tape:
        bodies: list[tuple[int, bytes]]

        def drain(self, limit: int = 256) -> list[tuple[int, bytes]]:
            return self.bodies

    tape = Tape()
    tape.bodies = [
        (CSI_CODE, encode_body(record(layout=20))),
        (CSI_CODE, encode_body(record(layout=34))),
        (CSI_CODE, encode_body(dataclasses.replace(record(), rate=0x101 | 0x800))),
        (CSI_CODE, encode_body(record(n_tx=2))),
        (0x42, b"of another kind"),
    ]
    radio = Radio(tape, {MAC: 2}, clock, samples.append, lambda *_: None)  # type: ignore[arg-type]
    radio.drain()
    counters = radio.counters
    assert (counters.records, counters.samples, counters.no_sender, counters.wide) == (4, 2, 1, 1)
    assert (counters.no_counter, counters.unknown_code) == (1, 1)
    assert samples[0].frame is None
    assert samples[1].frame == 7
    assert samples[1].csi.shape == (30, 3)
    assert radio.antenna_power()["A"] == 40 - 44.0 - 38
