"""Reports of an AX card on the live path: the same samples as any card's, on their own grid."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.core.clock import MonotonicClock
from companion.radio.card import ChannelSample, Radio
from companion.replay.recorded import RecordedCsi
from companion.sim.radio import simulate_exchanges
from companion.sim.scenario import RadioScenario
from csi_bridge.encoder import encode_body
from csi_bridge.feitcsi.channel import thinned
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.rate import Rate
from csi_bridge.feitcsi.records import FEITCSI_CODE
from csi_bridge.records import CSI_CODE
from csi_bridge.unix_socket import UnixFeeder, UnixSource
from tests import csi_records, feit_records
from tests.leg_scene import Scene, mac
from tests.manual_clock import ManualClock
from tests.sim_scenes import BEACON_MAC


def heard(bodies: list[tuple[int, bytes]]) -> tuple[list[ChannelSample], Radio]:
    samples: list[ChannelSample] = []
    peers = {feit_records.MAC: 2, csi_records.MAC: 3}
    source = RecordedCsi()
    source.add(bodies)
    radio = Radio(
        source=source, peers=peers, clock=ManualClock(10**9), on_sample=samples.append, on_record=lambda *_: None
    )
    radio.drain()
    return samples, radio


def test_a_report_becomes_a_sample_on_its_own_grid() -> None:
    record = feit_records.record(stamp_us=5000)
    samples, radio = heard([(FEITCSI_CODE, encode_record(record))])
    (sample,) = samples
    channel, hz = thinned(record)
    assert np.allclose(sample.csi[:, 0], channel[:, 0, 0], atol=1e-3)
    # Both chains are reported at one level: B received 5 dB less.
    assert np.allclose(sample.csi[:, 1], channel[:, 1, 0] * 10 ** (-5 / 20), atol=1e-3)
    assert sample.subcarrier_hz is not None and np.array_equal(sample.subcarrier_hz, hz)
    assert (sample.peer, sample.frame, sample.nic_us, sample.fine_us, sample.half_turns) == (
        2,
        None,
        5000,
        5000.0,
        True,
    )
    assert radio.rssi_dbm == (-40.0, -45.0, None)
    assert (radio.counters.records, radio.counters.samples, radio.counters.no_counter) == (1, 1, 1)


def test_one_chain_takes_the_place_of_its_antenna() -> None:
    record = feit_records.record(n_rx=1)
    only_b = replace(record, rate=Rate(record.rate.word & ~(1 << 14)))
    (sample,), _ = heard([(FEITCSI_CODE, encode_record(only_b))])
    assert not sample.csi[:, 0].any() and sample.csi[:, 1].all()


def test_strangers_and_broken_reports_are_counted() -> None:
    stranger = encode_record(replace(feit_records.record(), mac=b"\x02" * 6))
    samples, radio = heard([(FEITCSI_CODE, stranger), (FEITCSI_CODE, b"broken")])
    assert not samples
    assert (radio.counters.unknown_sender, radio.counters.malformed) == (1, 1)


def test_losses_are_counted_across_the_wrap_of_the_cards_counter() -> None:
    scene = Scene(math.radians(45), radio=RadioScenario(loss_probability=0.0))
    at_uav, _ = simulate_exchanges(scene.scenario, scene.uav, scene.beacon)
    numbered = [replace(record, bfee_count=(65500 + i) % 65536) for i, record in enumerate(at_uav)]
    kept = [record for i, record in enumerate(numbered) if not 20 <= i < 50 and i != 70]
    tape = RecordedCsi()
    tape.add((CSI_CODE, encode_body(record)) for record in kept)
    radio = Radio(
        source=tape,
        peers={mac(BEACON_MAC): 2},
        clock=ManualClock(1),
        on_sample=lambda _: None,
        on_record=lambda *_: None,
    )
    radio.drain()
    assert radio.counters.lost == 31
    assert radio.counters.samples == len(kept)


def test_a_record_is_stamped_when_it_arrived_however_late_it_is_read(tmp_path: Path) -> None:
    recorded_ns: list[int] = []
    samples: list[ChannelSample] = []
    source, feeder = UnixSource(tmp_path / "csi"), UnixFeeder(tmp_path / "csi")
    radio = Radio(
        source=source,
        peers={csi_records.MAC: 3},
        clock=MonotonicClock(),
        on_sample=samples.append,
        on_record=lambda t_ns, *_: recorded_ns.append(t_ns),
    )
    begun_us, sent_ns = time.monotonic_ns() // 1000, list[int]()
    for _ in range(4):
        sent_ns.append(time.monotonic_ns())
        record = replace(csi_records.record(), timestamp_low_us=(sent_ns[-1] // 1000 - begun_us) % (1 << 32))
        assert feeder.send(CSI_CODE, encode_body(record))
        time.sleep(0.02)
    time.sleep(0.05)
    assert radio.drain() == 4
    assert recorded_ns == pytest.approx(sent_ns, abs=10_000_000), "to the kernel it came when it was sent"
    assert [sample.t_mono_ns for sample in samples] == pytest.approx(sent_ns, abs=10_000_000)
    feeder.close()
    source.close()


def test_in_a_replay_each_record_arrives_when_the_log_says() -> None:
    recorded_ns: list[int] = []
    source = RecordedCsi()
    source.add([(CSI_CODE, encode_body(csi_records.record()))] * 3, [90, None, 200])
    radio = Radio(
        source=source,
        peers={},
        clock=ManualClock(100),
        on_sample=lambda _: None,
        on_record=lambda t_ns, *_: recorded_ns.append(t_ns),
    )
    assert radio.drain() == 3
    assert recorded_ns == [90, 100, 100], "never after the event"
