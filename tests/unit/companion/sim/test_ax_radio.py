"""The simulated AX card: what its records hold, against the physics of `propagate` and the public captures' manners."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from companion.sim.ax_radio import AxRadioLink, simulate_ax_exchanges
from companion.sim.propagation import Lattice, carrier_hz, propagate
from companion.sim.scenario import Scenario, ax210_radio
from csi_bridge.feitcsi.channel import channel
from csi_bridge.feitcsi.clock import fine_us
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.parser import parse_record
from csi_bridge.feitcsi.records import FeitRecord
from tests.feit_records import same
from tests.sim_scenes import CLEAN_RADIO, scene, straight, weave

Width = Literal[20, 40, 80, 160]
STILL = straight(np.array([0.0, 0.0, 1.5]), np.zeros(3), 1.0, 0.6, yaw_rad=0.0)
AWAY = straight(np.array([8.0, 0.0, 1.1]), np.zeros(3), 1.0, 0.6, yaw_rad=0.0)


def world(width_mhz: Width, seed: int = 3) -> Scenario:
    return scene(seed, ax210_radio(CLEAN_RADIO, width_mhz))


@pytest.mark.parametrize(("width_mhz", "subcarriers"), [(20, 242), (40, 484), (80, 996), (160, 1992)])
def test_records_are_such_as_the_card_reports(width_mhz: Width, subcarriers: int) -> None:
    at_uav, at_beacon = simulate_ax_exchanges(world(width_mhz), STILL, AWAY)
    assert len(at_uav) == len(at_beacon) > 40
    for record in (at_uav[0], at_beacon[-1]):
        read = parse_record(encode_record(record))
        assert same(read, replace(record, header=read.header))
        assert (record.csi.shape, str(record.rate)) == ((subcarriers, 2, 1), f"HE {width_mhz} MHz")
        # Every chain is scaled by itself: what it received is in its power alone.
        assert np.abs(record.csi).mean(axis=0).ravel() == pytest.approx([150, 150], rel=0.15)


def test_the_channel_is_that_of_the_waves_but_for_a_phase_and_a_delay() -> None:
    world_ = scene(3, ax210_radio(replace(CLEAN_RADIO, noise_dbm=-140.0), 80))
    record = simulate_ax_exchanges(world_, STILL, AWAY)[0][5]
    lattice = Lattice(record.tones.index, record.tones.spacing_hz)
    levers = np.array(world_.uav.antennas_m[:2])
    tx_m = AWAY.p_enu_m[:1] + np.array(world_.beacon.antennas_m[0])
    wave = propagate(tx_m, (STILL.p_enu_m[:1] + levers)[None], world_.radio, lattice)[0]
    for chain in (0, 1):
        ratio = channel(record)[:, chain, 0] / wave[:, chain]
        turned = ratio / np.abs(ratio)
        slope = np.angle((turned[1:] * turned[:-1].conj()).sum())
        left = turned * np.exp(-1j * slope * np.arange(len(turned)))
        assert abs(left.mean()) > 0.98
        assert slope < 0  # a delay lets phases fall with the frequency


@pytest.mark.parametrize("width_mhz", [20, 160])
def test_waves_over_a_lattice_are_the_sum_of_single_ones(width_mhz: Width) -> None:
    lattice = AxRadioLink(world(width_mhz)).lattice
    assert lattice is not None
    radio = replace(CLEAN_RADIO, reflectors=())
    found = propagate(np.zeros((1, 3)), np.array([[[5.0, 1.0, 0.5]]]), radio, lattice)[0, :, 0]
    d_m = np.sqrt(26.25)
    f_hz = carrier_hz(radio.channel) + lattice.hz
    wanted = (
        299_792_458.0 / (4 * np.pi * carrier_hz(radio.channel) * d_m) * np.exp(-2j * np.pi * f_hz * d_m / 299_792_458.0)
    )
    assert np.allclose(found, wanted, rtol=1e-9)


def test_each_chain_turns_by_half_a_turn_at_random() -> None:
    records = simulate_ax_exchanges(world(20), STILL, AWAY)[0]
    both = np.array([(np.vdot(r.csi[:, 0, 0], r.csi[:, 1, 0])) for r in records])
    sign = (both * both[0].conj()).real > 0
    assert 0.3 < sign.mean() < 0.7
    squared = both**2 / np.abs(both) ** 2
    assert abs(squared.mean()) > 0.99


def test_both_clocks_run_off_one_crystal() -> None:
    records = simulate_ax_exchanges(world(20), STILL, AWAY)[0]
    stamps = np.array([record.timestamp_low_us for record in records], np.uint32)
    fine = fine_us(np.array([record.ftm_ticks for record in records], np.uint32), stamps)
    assert np.abs((fine - fine[0]) - (stamps.astype(np.int64) - int(stamps[0]))).max() <= 1.0


def test_answers_come_a_jittered_millisecond_later() -> None:
    at_uav, at_beacon = simulate_ax_exchanges(world(20), STILL, AWAY)
    lag_us = np.array(
        [(a.timestamp_low_us - b.timestamp_low_us) % 2**32 for a, b in zip(at_uav, at_beacon, strict=True)]
    )
    assert 60 < np.std(lag_us) < 600


def test_the_same_records_come_in_whatever_pieces() -> None:
    world_ = replace(world(40, 9), radio=replace(ax210_radio(CLEAN_RADIO, 40), loss_probability=0.1))
    uav, beacon = weave(2.0), straight(np.array([9.0, 0.0, 0.5]), np.zeros(3), 0.0, 3.0, yaw_rad=0.0)
    whole = AxRadioLink(world_).advance(1.8, uav, beacon)
    link = AxRadioLink(world_)
    pieces: tuple[list[FeitRecord], list[FeitRecord]] = ([], [])
    for until_s in (0.3, 0.9, 1.0, 1.8):
        for kept, new in zip(pieces, link.advance(until_s, uav, beacon), strict=True):
            kept += new
    assert [list(map(encode_record, side)) for side in whole] == [list(map(encode_record, side)) for side in pieces]
