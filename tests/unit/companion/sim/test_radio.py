"""The simulated radio against physics written out again here: signs, clocks, power, losses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from companion.sim.draws import exchange_draws
from companion.sim.radio import RadioLink, exchange_times, simulate_exchanges
from companion.sim.scenario import RadioScenario, Scenario
from companion.sim.trajectory import Array, Trajectory
from csi_bridge.encoder import encode_body
from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, CsiRecord
from tests.sim_scenes import BEACON_MAC, CLEAN_RADIO, UAV_MAC, scene, straight, weave
from wsr.channel import bounded_amplitude, centre_channel, pair_by_counter
from wsr.geometry import direction, great_circle
from wsr.profile import bartlett_profile

Complex = npt.NDArray[np.complex128]
LIGHT_M_S = 299_792_458.0
LAMBDA_M = LIGHT_M_S / 5.54e9


def _antenna_a(records: list[CsiRecord]) -> Complex:
    return np.asarray(centre_channel(np.array([record.csi[:, 0, 0] for record in records])))


def _counters(records: list[CsiRecord]) -> npt.NDArray[np.int64]:
    return np.array([record.frame_count for record in records], np.int64)


def _host_s(records: list[CsiRecord]) -> Array:
    return np.array([record.host_time_ns for record in records], np.float64) * 1e-9


def _exchanged(scenario: Scenario, uav: Trajectory, beacon: Trajectory) -> tuple[Array, Array, Complex, Complex]:
    """(t_ping, t_answer, forward, reverse) of the exchanges that both ends recorded."""
    at_uav, at_beacon = simulate_exchanges(scenario, uav, beacon)
    i, j = pair_by_counter(_counters(at_beacon), _counters(at_uav))
    counters = _counters(at_beacon)[i]
    every = np.arange(counters[0], counters[-1] + 1)
    draws = exchange_draws(scenario.seed, int(every[0]), len(every))
    t_ping_s, t_answer_s = exchange_times(scenario, every, draws)
    rows = counters - counters[0]
    return t_ping_s[rows], t_answer_s[rows], _antenna_a(at_beacon)[i], _antenna_a(at_uav)[j]


def _coherence(values: Complex) -> float:
    return float(abs(np.mean(values / np.abs(values))))


def _still(distance_m: float, duration_s: float = 2.0, start_s: float = 1.0) -> tuple[Trajectory, Trajectory]:
    none = np.zeros(3)
    uav = straight(np.array([0.0, 0.0, 1.5]), none, start_s, duration_s, yaw_rad=0.0)
    return uav, straight(np.array([distance_m, 0.0, 1.1]), none, start_s, duration_s, yaw_rad=0.0)


@pytest.mark.parametrize("seed", range(8))
def test_a_woven_aperture_gives_the_true_bearing_on_the_way_to_the_beacon(seed: int) -> None:
    """At 10 m, flying roughly towards the beacon (across the way, the wave's curvature alone turns it by 3 degrees);
    half of the seeds have the beacon drive."""
    rng = np.random.default_rng(seed)
    azimuth_rad = rng.uniform(-math.pi, math.pi)
    true = direction(azimuth_rad, math.pi / 2 + rng.uniform(-0.3, 0.3))
    assert _bearing_error_deg(seed, true, 10.0, azimuth_rad + rng.uniform(-0.4, 0.4)) < 2.0


@pytest.mark.parametrize("seed", range(8))
def test_a_woven_aperture_gives_any_far_bearing(seed: int) -> None:
    """So far away that the wave is plane: then the heading does not matter, nor how steep the direction is."""
    rng = np.random.default_rng(seed)
    true = direction(rng.uniform(-math.pi, math.pi), math.acos(rng.uniform(-0.9, 0.9)))
    assert _bearing_error_deg(seed, true, 120.0, rng.uniform(-math.pi, math.pi)) < 1.0


def _bearing_error_deg(seed: int, true: Array, distance_m: float, heading_rad: float) -> float:
    radio = replace(CLEAN_RADIO, loss_probability=0.05, turnaround_jitter_s=5e-6, tx_power_dbm=15.0)
    scenario = scene(seed, radio)
    uav = weave(heading_rad)
    levers_m = np.array(scenario.uav.antennas_m), np.array(scenario.beacon.antennas_m)
    middle_m = uav.antennas_at(uav.t_s, levers_m[0])[:, 0].mean(axis=0)
    drive = 0.1 * direction(heading_rad + 2.0, math.pi / 2) * (seed % 2)
    beacon = straight(middle_m + distance_m * true - levers_m[1][0], drive, uav.t_s[0], 3.0, yaw_rad=1.0)
    t_s, _, forward, reverse = _exchanged(scenario, uav, beacon)
    ours_m, theirs_m = uav.antennas_at(t_s, levers_m[0])[:, 0], beacon.antennas_at(t_s, levers_m[1])[:, 0]
    relative_m = ours_m - theirs_m
    away_m = -relative_m.mean(axis=0)
    profile = bartlett_profile(relative_m + away_m, bounded_amplitude(forward * reverse), LAMBDA_M)
    row, column = np.unravel_index(np.argmax(profile.power), profile.power.shape)
    found = _refined(relative_m + away_m, forward * reverse, profile.azimuth_rad[column], profile.polar_rad[row])
    return math.degrees(float(great_circle(found, away_m / np.linalg.norm(away_m))))


def _refined(chi_m: Array, product: Complex, azimuth_rad: float, polar_rad: float) -> Array:
    """The best direction within 1.2 degrees of a grid point, in steps of 0.1."""
    near = np.radians(np.arange(-1.2, 1.25, 0.1))
    steps = np.stack(np.meshgrid(near, near), axis=-1).reshape(-1, 2)
    candidates = direction(azimuth_rad + steps[:, 0] / math.sin(polar_rad), polar_rad + steps[:, 1])
    power = np.abs(np.exp(-4j * math.pi / LAMBDA_M * candidates @ chi_m.T) @ bounded_amplitude(product))
    best: Array = candidates[int(np.argmax(power))]
    return best


def test_the_product_turns_with_the_sum_of_both_distances() -> None:
    scenario = scene(3, replace(CLEAN_RADIO, tx_power_dbm=30.0), uav_ppm=1.0, beacon_ppm=1.0)
    uav = weave(0.7)
    beacon = straight(np.array([3.0, -4.0, 0.2]), np.array([0.1, 0.0, 0.0]), uav.t_s[0], 3.0, yaw_rad=2.0)
    t_ping_s, t_answer_s, forward, reverse = _exchanged(scenario, uav, beacon)
    turns = np.zeros(len(t_ping_s))
    for t_s in (t_ping_s, t_answer_s):
        a = uav.antennas_at(t_s, np.array(scenario.uav.antennas_m))[:, 0]
        b = beacon.antennas_at(t_s, np.array(scenario.beacon.antennas_m))[:, 0]
        turns += np.linalg.norm(a - b, axis=1) / LAMBDA_M
    assert np.ptp(turns) > 10
    assert _coherence(forward * reverse * np.exp(2j * math.pi * turns)) > 0.999
    assert _coherence(forward * reverse * np.exp(-2j * math.pi * turns)) < 0.3


def test_carrier_offset_has_opposite_signs_at_the_ends_and_cancels_in_the_product() -> None:
    scenario = scene(5, replace(CLEAN_RADIO, turnaround_jitter_s=5e-6, turnaround_outlier_probability=0.03))
    t_ping_s, t_answer_s, forward, reverse = _exchanged(scenario, *_still(8.0))
    df_hz = 5.54e9 * (1.5 + 0.5) * 1e-6
    assert _coherence(forward) < 0.2
    assert _coherence(reverse) < 0.2
    assert _coherence(forward * np.exp(-2j * math.pi * df_hz * t_ping_s)) > 0.99
    assert _coherence(reverse * np.exp(2j * math.pi * df_hz * t_answer_s)) > 0.99
    product = forward * reverse
    raw = _coherence(product)
    corrected = _coherence(product * np.exp(2j * math.pi * df_hz * (t_answer_s - t_ping_s)))
    assert 0.8 < raw < 0.97, "the turnaround jitter must leave its mark"
    assert corrected > 0.99


def test_nic_clocks_run_with_the_crystals_and_give_the_carrier_offset() -> None:
    scenario = scene(2, replace(CLEAN_RADIO, turnaround_jitter_s=5e-6))
    at_uav, at_beacon = simulate_exchanges(scenario, *_still(8.0, 20.0))
    ticks = [
        np.unwrap(np.array([r.timestamp_low_us for r in records], float), period=2**32)
        for records in (at_uav, at_beacon)
    ]
    skew_ppm = np.polyfit(ticks[1] - ticks[1][0], ticks[0] - ticks[1], 1)[0] * 1e6
    assert skew_ppm == pytest.approx(2.0, abs=0.1)


def test_nic_clock_wraps_at_32_bits() -> None:
    scenario = scene(4, CLEAN_RADIO)
    first = simulate_exchanges(scenario, *_still(8.0, 0.1))[0][0]
    wrap_s = 1.0 + (2**32 - first.timestamp_low_us) * 1e-6
    at_uav, _ = simulate_exchanges(scenario, *_still(8.0, 1.0, wrap_s - 0.5))
    ticks = np.array([record.timestamp_low_us for record in at_uav])
    assert np.count_nonzero(np.diff(ticks) < 0) == 1
    assert ticks.max() < 2**32 and ticks.min() >= 0
    assert np.all(np.diff(np.unwrap(ticks.astype(float), period=2**32)) > 0)


def test_records_carry_what_the_driver_writes() -> None:
    scenario = scene(6)
    at_uav, at_beacon = simulate_exchanges(scenario, *_still(8.0))
    for records, mac in ((at_uav, BEACON_MAC), (at_beacon, UAV_MAC)):
        for record in records:
            assert record.mac is not None and record.mac.hex(":").upper() == mac
            again = parse_body(CSI_CODE, encode_body(record))
            assert isinstance(again, CsiRecord)
            assert np.array_equal(again.csi, record.csi)
            assert (again.frame_count, again.host_time_ns, again.rssi) == (
                record.frame_count,
                record.host_time_ns,
                record.rssi,
            )
    i, j = pair_by_counter(_counters(at_beacon), _counters(at_uav))
    assert np.median(_host_s(at_beacon)[i] - _host_s(at_uav)[j]) == pytest.approx(38.0, abs=0.001)
    assert {r.antenna_sel for r in at_uav} == {0x18, 0x24}


@pytest.mark.parametrize("distance_m", [2.0, 8.0, 16.0])
def test_rssi_and_agc_give_the_power_of_friis(distance_m: float) -> None:
    scenario = scene(7, CLEAN_RADIO)
    at_uav, _ = simulate_exchanges(scenario, *_still(distance_m))
    friis_dbm = 5.0 + 20 * math.log10(LAMBDA_M / (4 * math.pi * distance_m))
    for record in at_uav:
        dbm = 10 * math.log10(sum(10 ** (level / 10) for level in record.rssi)) - 44 - record.agc
        assert dbm == pytest.approx(friis_dbm, abs=1.2)
        assert 20 < np.abs(record.csi[:, 0]).mean() < 40
        assert np.abs(record.csi[:, 1:]).mean() < 5


def test_losses_are_independent_and_the_card_counts_what_it_heard() -> None:
    scenario = scene(8, RadioScenario(loss_probability=0.2))
    link = RadioLink(scenario)
    at_uav, at_beacon = link.advance(21.0, *_still(8.0, 20.0))
    lost = [
        np.isin(np.arange(1, link.exchanges + 1), _counters(records), invert=True) for records in (at_uav, at_beacon)
    ]
    assert link.exchanges == pytest.approx(21 * 150, abs=3)
    assert [np.mean(gone) for gone in lost] == pytest.approx([0.2, 0.2], abs=0.03)
    assert np.mean(lost[0] & lost[1]) == pytest.approx(0.04, abs=0.015)
    for records in (at_uav, at_beacon):
        assert set(np.diff([r.bfee_count for r in records]) % 2**16) == {1}


def test_the_same_seed_gives_the_same_bytes_in_whatever_steps() -> None:
    uav, beacon = _still(8.0)
    whole = [encode_body(r) for records in simulate_exchanges(scene(9), uav, beacon) for r in records]
    assert whole == [encode_body(r) for records in simulate_exchanges(scene(9), uav, beacon) for r in records]
    assert whole != [encode_body(r) for records in simulate_exchanges(scene(10), uav, beacon) for r in records]
    link = RadioLink(scene(9))
    link.skip_to(1.0)
    parts: tuple[list[bytes], list[bytes]] = ([], [])
    for until_s in np.arange(1.0, 3.0 + 1e-9, 0.005):
        for part, records in zip(parts, link.advance(float(until_s), uav, beacon), strict=True):
            part += [encode_body(r) for r in records]
    assert parts[0] + parts[1] == whole


def test_detection_delay_tilts_the_phase_over_the_subcarriers() -> None:
    at_uav, _ = simulate_exchanges(scene(11, replace(CLEAN_RADIO, tx_power_dbm=25.0)), *_still(3.0))
    csi = np.array([record.csi[:, 0, 0] for record in at_uav])
    step = np.angle(np.sum(csi[:, 1:14] * csi[:, :13].conj(), axis=1))  # two indices apart there
    delay_ns = -step / (2 * math.pi * 2 * 312_500.0) * 1e9
    assert delay_ns.mean() == pytest.approx(200 + 3.0 / LIGHT_M_S * 1e9, abs=5)
    assert delay_ns.std() == pytest.approx(25, rel=0.15)
