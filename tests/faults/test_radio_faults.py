"""The radio's own faults through the real kernel path: flood (12), silence (13), restart of the driver (15)."""

from __future__ import annotations

import asyncio
import dataclasses
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.mission.table import State
from companion.radio.card import ChannelSample, Radio
from companion.replay.recorded import RecordedCsi
from companion.sim.scenario import RadioScenario
from companion.study.link import scenario
from companion.study.virtual_clock import VirtualClock
from companion.study.virtual_mission import _World, with_levers
from companion.study.virtual_parts import RadioFeed
from csi_bridge.encoder import encode_body
from csi_bridge.netlink import NetlinkFeeder, NetlinkSource
from csi_bridge.records import CSI_CODE, CsiRecord
from tests.connectors import claimed, needs_netlink
from tests.csi_records import MAC, record
from tests.faults.figures import record as note
from tests.manual_clock import ManualClock


class Card:
    """A driver that counts and stamps, and a service's radio behind the real connector."""

    def __init__(self, idx: int, receive_buffer_bytes: int) -> None:
        self.clock = ManualClock(1000 * NS_PER_S)
        self.source = NetlinkSource(idx, require_kernel_sender=False, receive_buffer_bytes=receive_buffer_bytes)
        self.feeder = NetlinkFeeder(idx)
        self.samples: list[ChannelSample] = []
        self.radio = Radio(
            source=self.source,
            peers={MAC: 2},
            clock=self.clock,
            on_sample=self.samples.append,
            on_record=lambda *_: None,
        )
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

    def _stamped(self, plain: CsiRecord) -> CsiRecord:
        return dataclasses.replace(plain, bfee_count=self.count, timestamp_low_us=self.stamp_us)


@contextmanager
def _card(receive_buffer_bytes: int = 1 << 20) -> Iterator[Card]:
    with claimed(1) as (idx,):
        card = Card(idx, receive_buffer_bytes)
        try:
            yield card
        finally:
            card.feeder.close()
            card.source.close()


@needs_netlink
def test_fault_12_a_flood_is_survived_and_its_loss_counted_exactly_across_the_wrap() -> None:
    with _card(receive_buffer_bytes=64 << 10) as card:
        card.send(100)
        sent = 3000
        card.send(sent, period_s=0.0005, drained=False)
        before = len(card.samples)
        while len(card.samples) > before or card.source.counters.overruns == 0:
            before = len(card.samples)
            card.radio.drain()
        card.send(1)  # the first that comes through shows what was lost
        lost = 100 + sent + 1 - len(card.samples)
        assert card.source.counters.overruns >= 1
        assert card.radio.counters.lost == lost
        assert 0 < lost < sent
        card.send(50)
        assert len(card.samples) + lost == 100 + sent + 51
        note(12, "flood over the socket buffer", sent=sent, lost=lost, counted=card.radio.counters.lost)


@needs_netlink
def test_fault_15_a_restarted_driver_is_back_at_once() -> None:
    with _card() as card:
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


@pytest.mark.parametrize("state", [State.ACQUIRING, State.APPROACHING])
def test_fault_13_two_seconds_of_silence_are_a_stale_bearing_and_hold_the_vehicle(state: State) -> None:
    """The whole flight in virtual time: from the last packet of the target to the hold, and how far it goes in it."""
    flown = asyncio.run(_silenced(state))
    if state is State.APPROACHING:  # before there is no bearing that could be anything but stale
        assert flown.stale_after_s == pytest.approx(2.0, abs=0.2)
    assert flown.holding_after_s == pytest.approx(2.0, abs=0.3)
    assert flown.moved_in_hold_m < 0.3
    note(
        13,
        f"CSI silent while {state}",
        holding_after_s=round(flown.holding_after_s, 2),
        moved_in_3_s_m=round(flown.moved_in_hold_m, 2),
    )


@dataclasses.dataclass(frozen=True, slots=True)
class _Silenced:
    stale_after_s: float
    holding_after_s: float
    moved_in_hold_m: float


async def _silenced(state: State) -> _Silenced:
    """Flies until it has been in `state` for two seconds, takes all packets away, and goes on for five seconds of
    hold."""
    clock = VirtualClock()
    scene = replace(scenario(np.random.SeedSequence(3), RadioScenario(reflectors=())), start_distance_m=12.0)
    world = _World(scenario=with_levers(scene), gust_seed=3, wander_seed=4, clock=clock, max_time_s=120.0)
    in_state_ns = last_ns = stale_ns = holding_ns = 0
    held_m: list[Vector3] = []

    def live(now_ns: int) -> bool:
        nonlocal in_state_ns, last_ns, stale_ns, holding_ns
        flight = world.flight
        if not in_state_ns and flight.state is state:
            in_state_ns = now_ns
        if in_state_ns and not last_ns and now_ns - in_state_ns > 2 * NS_PER_S:
            assert flight.state is state
            last_ns = now_ns
            world._radio = _Mute(world._radio)  # type: ignore[assignment]
        if last_ns and not stale_ns and flight.status()["bearing_stale"]:
            stale_ns = now_ns
        if last_ns and not holding_ns and flight.state is State.HOLDING:
            holding_ns = now_ns
        if holding_ns and now_ns - holding_ns > 2 * NS_PER_S:
            held_m.append(world._vehicle.airframe.p_enu_m)
        return world.live(now_ns) and not (holding_ns and now_ns - holding_ns > 5 * NS_PER_S)

    flying = asyncio.create_task(world.flight.run())
    await clock.run(live)
    flying.cancel()
    await asyncio.gather(flying, return_exceptions=True)
    assert holding_ns, f"it never held; in the end it was {world.flight.state}"
    moved_m = max(math.dist(held_m[0], p_m) for p_m in held_m)
    return _Silenced((stale_ns - last_ns) / NS_PER_S, (holding_ns - last_ns) / NS_PER_S, moved_m)


class _Mute:
    """A radio that hears nothing."""

    def __init__(self, radio: RadioFeed) -> None:
        self._radio = radio

    def samples(self, until_s: float, *_: object) -> list[tuple[bool, ChannelSample]]:
        self._radio.skip_to(until_s)
        return []

    def skip_to(self, until_s: float) -> None:
        self._radio.skip_to(until_s)


def test_layout_34_and_40_mhz_and_stock_records_are_told_apart() -> None:
    clock, samples = ManualClock(NS_PER_S), list[ChannelSample]()
    tape = RecordedCsi()
    tape.add([
        (CSI_CODE, encode_body(record(layout=20))),
        (CSI_CODE, encode_body(record(layout=34))),
        (CSI_CODE, encode_body(dataclasses.replace(record(), rate=0x101 | 0x800))),
        (CSI_CODE, encode_body(record(n_tx=2))),
        (0x42, b"of another kind"),
    ])  # fmt: skip
    radio = Radio(source=tape, peers={MAC: 2}, clock=clock, on_sample=samples.append, on_record=lambda *_: None)
    radio.drain()
    counters = radio.counters
    assert (counters.records, counters.samples, counters.no_sender, counters.wide) == (4, 2, 1, 1)
    assert (counters.no_counter, counters.unknown_code) == (1, 1)
    assert samples[0].frame is None
    assert samples[1].frame == 7
    assert samples[1].csi.shape == (30, 3)
    assert radio.antenna_power()["A"] == 40 - 44.0 - 38
