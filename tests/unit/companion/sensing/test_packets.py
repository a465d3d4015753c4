"""Channels that stay packed until they are wanted are the same to the last bit, whenever that is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from companion.radio.card import ChannelSample, Radio, packed_channels
from companion.replay.recorded import RecordedCsi
from companion.sensing.packets import FRAME, Packets, T
from csi_bridge.encoder import encode_body
from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, CsiRecord
from csi_bridge.scaling import without_spatial_mapping
from tests import csi_records
from tests.manual_clock import ManualClock


def _heard(records: list[CsiRecord]) -> list[ChannelSample]:
    tape, samples, clock = RecordedCsi(), list[ChannelSample](), ManualClock(10**9)
    radio = Radio(
        source=tape, peers={csi_records.MAC: 2}, clock=clock, on_sample=samples.append, on_record=lambda *_: None
    )
    for number, record in enumerate(records):
        clock.advance(0.005)
        stamped = replace(record, frame_count=number, timestamp_low_us=number * 5000)
        tape.add([(CSI_CODE, encode_body(stamped))])
        radio.drain()
    return samples


def _mixed(count: int) -> list[CsiRecord]:
    """Antennas of all numbers, in all orders, one and more streams."""
    draw = np.random.default_rng(3)
    made = []
    for number in range(count):
        n_rx, n_tx = (int(value) for value in draw.integers(1, 4, 2))
        record = csi_records.record(n_rx, n_tx, seed=number)
        selected = (0b00_10_01, 0b10_01_00, 0b01_00_10, 0b00_00_10)[number % 4]
        made.append(replace(record, antenna_sel=selected, rate=(0x4101, 0x4901, 0x4001)[number % 3]))
    return made


def test_many_at_once_are_what_each_is() -> None:
    records = _mixed(60)
    found = packed_channels([encode_body(record) for record in records])
    for record, csi in zip(records, found, strict=True):
        parsed = parse_body(CSI_CODE, encode_body(record))
        assert isinstance(parsed, CsiRecord)
        wanted = np.zeros((30, 3), np.complex64)
        wanted[:, list(parsed.antennas)] = without_spatial_mapping(parsed.csi, parsed.rate)[:, :, 0]
        assert np.array_equal(csi, wanted)


@pytest.mark.parametrize("asked_every", [1, 7, 1000])
def test_it_does_not_matter_when_and_how_often_they_are_asked_for(asked_every: int) -> None:
    samples = _heard([record for record in _mixed(300) if not record.rate & 1 << 11])
    packets = Packets(samples[0], 64)
    for count, sample in enumerate(samples, 1):
        packets.add(sample)
        if count % asked_every and count != len(samples):
            continue
        stamps = packets.stamps(0, sample.t_mono_ns)
        newest = samples[max(0, count - 64) : count]
        assert stamps[:, FRAME].tolist() == [one.frame for one in newest]
        assert stamps[:, T].tolist() == [one.t_mono_ns for one in newest]
        wanted = np.array([one.csi for one in newest]).view(np.float32).astype(np.float16)
        assert np.array_equal(packets.channels(stamps).view(np.float32), wanted)
        some = stamps[3:9]
        assert np.array_equal(packets.channels(some), packets.channels(stamps)[3:9])


def test_packets_that_brought_their_channel_are_kept_beside_them() -> None:
    samples = _heard([csi_records.record(seed=number) for number in range(8)])
    packets = Packets(samples[0], 4)
    for number, sample in enumerate(samples):
        packets.add(sample._replace(channel=sample.csi) if number % 2 else sample)
    found = packets.channels(packets.stamps(0, samples[-1].t_mono_ns))
    assert np.array_equal(found, np.array([one.csi for one in samples[-4:]]))
