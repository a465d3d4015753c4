"""The NIC clock against simulated crystals: drift, wraps, resets and one-sided delays."""

from __future__ import annotations

import numpy as np
import pytest

from csi_bridge.clock import NicClock, envelope, host_step, host_times_s

WRAP_US = 1 << 32


def run(
    start_us: int, skew: float, seed: int = 1, seconds: float = 60.0, rate_hz: float = 250.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True reception times [ns], time stamps [us] and when the host read them [ns], late by 0.1 ms and up to 20 ms."""
    rng = np.random.default_rng(seed)
    true_ns = np.cumsum(rng.exponential(1e9 / rate_hz, int(seconds * rate_hz))) + 5e12
    stamps_us = (start_us + np.round((true_ns - true_ns[0]) * 1e-3 * (1 + skew)).astype(np.int64)) % WRAP_US
    delay_ns = 1e5 + rng.exponential(2e5, len(true_ns)) + (rng.random(len(true_ns)) < 0.02) * rng.uniform(0, 2e7)
    return true_ns, stamps_us, true_ns + delay_ns


@pytest.mark.parametrize("skew", [0.0, 40e-6, -40e-6, 95e-6])
@pytest.mark.parametrize("start_us", [1000, WRAP_US - 20_000_000])
def test_delay_jitter_is_removed(skew: float, start_us: int) -> None:
    true_ns, stamps_us, read_ns = run(start_us, skew)
    clock = NicClock()
    mapped_ns = np.array([clock.update(int(s), int(t)) for s, t in zip(stamps_us, read_ns, strict=True)])
    assert np.all(mapped_ns <= read_ns)
    assert clock.resets == 0
    # The constant 0.1 ms is not observable; what is left of the rest is small against the 2.7 ms between packets.
    late_ns = (mapped_ns - true_ns - 1e5)[2000:]
    assert np.abs(late_ns).max() < 60e3
    assert np.abs((read_ns - true_ns - 1e5)[2000:]).max() > 5e6


def test_a_reset_of_the_counter_starts_over() -> None:
    true_ns, stamps_us, read_ns = run(3_000_000_000, 20e-6)
    half = len(stamps_us) // 2
    stamps_us[half:] -= stamps_us[half] - 17
    clock = NicClock()
    mapped_ns = np.array([clock.update(int(s), int(t)) for s, t in zip(stamps_us, read_ns, strict=True)])
    assert clock.resets == 1
    assert np.abs(mapped_ns - true_ns - 1e5)[half + 1000 :].max() < 100e3


def test_records_slightly_out_of_order_are_no_wrap() -> None:
    clock = NicClock()
    first = clock.update(50, 1_000_000_000)
    earlier = clock.update(WRAP_US - 950, 1_000_500_000)
    assert clock.resets == 0
    assert earlier == first - 1_000_000


def test_slope_is_limited_and_needs_a_span() -> None:
    assert envelope([(0.0, 5.0)]) == (0.0, 5.0)
    assert envelope([(0.0, 0.0), (1e9, 50e3)]) == (0.0, 0.0)
    slope, intercept = envelope([(0.0, 0.0), (5e9, 200e3), (10e9, 400e3)])
    assert slope == pytest.approx(40e-6, abs=1e-6)
    assert -5e3 < intercept < 0.0  # other lines fit as well, and no line may be above the points
    assert envelope([(0.0, 0.0), (10e9, 400e6)])[0] == pytest.approx(100e-6, abs=1e-6)
    steep = [(1e9 * i, 1e6 * i) for i in range(40)]
    assert envelope(steep)[0] == pytest.approx(100e-6, abs=1e-7)


@pytest.mark.parametrize("law", ["uniform", "exponential", "half normal"])
@pytest.mark.parametrize("seed", range(4))
def test_a_fifth_of_a_millisecond_is_left_of_twenty(law: str, seed: int) -> None:
    """At 60 packets a second, one in twenty of them up to half a second late, from 20 s on."""
    rng = np.random.default_rng(seed)
    true_ns = np.cumsum(rng.exponential(1e9 / 60, 60 * 60)) + 5e12
    skew = rng.uniform(-60e-6, 60e-6)
    stamps_us = np.round((true_ns - true_ns[0]) * 1e-3 * (1 + skew)).astype(np.int64)
    size = len(true_ns)
    delay_ns = {
        "uniform": rng.uniform(0.0, 20e6, size),
        "exponential": rng.exponential(20e6 / 3, size),
        "half normal": np.abs(rng.normal(0.0, 10e6, size)),
    }[law] + (rng.random(size) < 0.05) * rng.uniform(0.0, 5e8, size)
    clock = NicClock()
    mapped_ns = [clock.update(int(s), int(t)) for s, t in zip(stamps_us, true_ns + delay_ns, strict=True)]
    assert np.abs(mapped_ns - true_ns)[true_ns - true_ns[0] > 20e9].max() < 200e3


def test_whole_recordings_at_once() -> None:
    true_ns, stamps_us, read_ns = run(WRAP_US - 5_000_000, -30e-6)
    mapped_s = host_times_s(stamps_us.astype(np.uint32), read_ns * 1e-9)
    assert np.abs(mapped_s - true_ns * 1e-9 - 1e-4).max() < 60e-6


def test_recordings_without_host_time_have_no_host_times() -> None:
    stamps_us = np.arange(5, dtype=np.uint32)
    assert np.all(np.isnan(host_times_s(stamps_us, np.full(5, np.nan))))
    assert len(host_times_s(stamps_us[:0], np.zeros(0))) == 0


@pytest.mark.parametrize("wrong_s", [0.3, -0.3, -0.02, 0.7, -0.7, 1000.0])
@pytest.mark.parametrize("clock", ["host", "nic"])
def test_single_wrong_stamps_move_no_other_packet(wrong_s: float, clock: str) -> None:
    _, stamps_us, read_ns = run(WRAP_US - 5_000_000, -30e-6, seconds=20.0)
    stamps_us, host_s = stamps_us.astype(np.int64), read_ns * 1e-9
    wrong = np.array([0, 7, 1000, 1001, 2500, len(host_s) - 1])
    before_s = host_times_s(stamps_us.astype(np.uint32), host_s)
    if clock == "host":
        host_s[wrong] += wrong_s
    else:
        stamps_us[wrong] = (stamps_us[wrong] + round(wrong_s * 1e6)) % WRAP_US
    after_s = host_times_s(stamps_us.astype(np.uint32), host_s)
    moved_s = np.abs(np.delete(after_s - before_s, wrong))
    assert moved_s.max() < 1e-4


@pytest.mark.parametrize("wrong_us", [300_000, -300_000, 20_000, -20_000])
def test_a_wrong_stamp_in_flight_moves_no_other_packet(wrong_us: int) -> None:
    true_ns, stamps_us, read_ns = run(WRAP_US - 5_000_000, -30e-6, seconds=20.0)
    wrong = np.array([3, 700, 1000, 2500])
    stamps_us[wrong] = (stamps_us[wrong] + wrong_us * np.array([10, 7, 5, 9]) // 10) % WRAP_US
    clock = NicClock()
    mapped_ns = np.array([clock.update(int(s), int(t)) for s, t in zip(stamps_us, read_ns, strict=True)])
    assert clock.resets == 0
    others = np.delete(np.arange(len(true_ns)), wrong)
    assert np.abs(mapped_ns - true_ns - 1e5)[others[500:]].max() < 0.2e6
    again_ns = clock.host_ns(stamps_us.astype(np.uint32))
    assert np.abs(again_ns - true_ns - 1e5)[others].max() < 0.1e6


def test_late_packets_are_found_out_by_two_that_agree() -> None:
    clock = NicClock()
    late_ms = [9, 8, 0.3, 7, 0.2, 6]
    mapped_ms = [clock.update(10_000 * i, round((10 * i + late) * 1e6)) * 1e-6 for i, late in enumerate(late_ms)]
    assert np.subtract(mapped_ms, 10 * np.arange(6)) == pytest.approx([9, 8, 0.3, 7, 0.2, 0.2], abs=0.01)


def test_a_wrong_stamp_in_a_short_recording() -> None:
    host_s, stamps_us = np.asarray(np.arange(6) * 0.01 + 50.0, np.float64), np.arange(6, dtype=np.uint32) * 10_000
    wrong_s = host_s.copy()
    wrong_s[2] -= 0.3
    assert host_times_s(stamps_us.astype(np.uint32), wrong_s) == pytest.approx(host_s, abs=1e-6)


def test_a_wrong_stamp_does_not_cut_a_recording_in_two() -> None:
    host_s, stamps_us = np.asarray(np.arange(300) * 0.01 + 50.0, np.float64), np.arange(300) * 10_000
    read_s = host_s.copy()
    # Alone, the late packets at the end would not show that they are late.
    read_s[-6:] += 0.01
    read_s[-6] += 1000.0
    assert host_times_s(stamps_us.astype(np.uint32), read_s) == pytest.approx(host_s, abs=1e-6)


@pytest.mark.parametrize(("jump_us", "resets"), [(499_000, 0), (-499_000, 0), (501_000, 1), (-501_000, 1)])
def test_half_a_second_of_disagreement_is_a_reset(jump_us: int, resets: int) -> None:
    clock = NicClock()
    clock.update(5_000_000, 7_000_000_000)
    mapped_ns = clock.update(5_010_000 + jump_us, 7_010_000_000)
    assert clock.resets == resets
    if resets:
        assert mapped_ns == 7_010_000_000
    stamps_us = np.arange(400) * 10_000 + jump_us * (np.arange(400) >= 200)
    host_s = np.asarray(np.arange(400) * 0.01 + 100.0, np.float64)
    mapped_s = host_times_s((stamps_us % WRAP_US).astype(np.uint32), host_s)
    # Without a reset the whole recording has one line, so that a jump shows; with one each part has its own.
    assert (np.abs(mapped_s - host_s).max() < 1e-6) == (resets == 1)


def test_nothing_is_remembered_over_a_reset() -> None:
    clock = NicClock()
    # The first packets came early by what later ones were late.
    for n in range(100):
        clock.update(1_000_000 + 100_000 * n, 9_000_000_000 + 100_000_000 * n - (50_000_000 if n == 50 else 0))
    assert clock.update(17, 90_000_000_000) == 90_000_000_000
    assert clock.resets == 1
    assert clock.update(100_017, 90_100_000_000) == 90_100_000_000


def test_recordings_slightly_out_of_order() -> None:
    true_ns, stamps_us, read_ns = run(3_000_000_000, 60e-6, seconds=30.0)
    order = np.argsort(np.arange(len(true_ns)) + 60 * (np.arange(len(true_ns)) % 50 == 0), kind="stable")
    host_s = read_ns * 1e-9
    mapped_s = host_times_s(stamps_us[order].astype(np.uint32), host_s[order])
    assert np.any(np.diff(stamps_us[order]) < 0)
    assert mapped_s == pytest.approx(host_times_s(stamps_us.astype(np.uint32), host_s)[order], abs=1e-9)
    # Enough of them to be no single wrong stamps: a step back is a step back, not a wrap.
    halves = np.concatenate([np.arange(3500, 3600), np.arange(3400, 3500)])
    mapped_s = host_times_s(stamps_us[halves].astype(np.uint32), host_s[halves])
    assert mapped_s - true_ns[halves] * 1e-9 == pytest.approx(np.full(200, 1e-4), abs=2e-4)


@pytest.mark.parametrize("skew", [-40e-6, 0.0, 40e-6])
@pytest.mark.parametrize("start_us", [1000, WRAP_US - 20_000_000])
def test_twenty_milliseconds_of_jitter_and_outliers_leave_a_fifth_of_one(skew: float, start_us: int) -> None:
    """Every packet is late by up to 20 ms, one in twenty by up to half a second."""
    rng = np.random.default_rng(11)
    true_ns = np.cumsum(rng.exponential(1e9 / 150, 9000)) + 5e12
    stamps_us = (start_us + np.round((true_ns - true_ns[0]) * 1e-3 * (1 + skew)).astype(np.int64)) % WRAP_US
    outlier = rng.random(len(true_ns)) < 0.05
    read_ns = true_ns + rng.uniform(0, 20e6, len(true_ns)) + outlier * rng.uniform(0, 480e6, len(true_ns))
    clock = NicClock()
    mapped_ns = np.array([clock.update(int(s), int(t)) for s, t in zip(stamps_us, read_ns, strict=True)])
    assert clock.resets == 0
    settled = np.abs(clock.host_ns(stamps_us[-1500:].astype(np.uint32)) - true_ns[-1500:])
    assert settled.max() < 0.2e6
    assert np.quantile(np.abs(mapped_ns - true_ns)[2000:], 0.9) < 0.5e6


def test_a_host_that_stalled_is_no_reset_of_the_card() -> None:
    clock = NicClock()
    for number in range(1000):
        clock.update(number * 5000, 10_000_000_000 + number * 5_000_000)
    # Two seconds of records are read at once, then those that were lost are missing.
    late_ns = 10_000_000_000 + 1400 * 5_000_000
    for number in range(1000, 1200):
        assert abs(clock.update(number * 5000, late_ns) - 10_000_000_000 - number * 5_000_000) < 200_000
    assert abs(clock.update(1400 * 5000, late_ns) - late_ns) < 200_000
    assert clock.resets == 0


@pytest.mark.parametrize("law", ["uniform", "exponential", "half-normal"])
def test_so_it_does_at_the_default_rate_of_pings_whatever_the_draw(law: str) -> None:
    """120 packets a second, from 20 s after the first: live, and as an aperture has it, which takes its times anew."""
    for seed in range(6):
        rng = np.random.default_rng(seed)
        true_ns = np.cumsum(rng.exponential(1e9 / 120, 7200)) + 5e12
        stamps_us = np.round((true_ns - true_ns[0]) * 1e-3 * (1 + 30e-6)).astype(np.int64)
        late_ns = {
            "uniform": rng.uniform(0, 20e6, len(true_ns)),
            "exponential": rng.exponential(20e6, len(true_ns)),
            "half-normal": np.abs(rng.normal(0, 20e6, len(true_ns))),
        }[law]
        late_ns += (rng.random(len(true_ns)) < 0.05) * rng.uniform(0, 480e6, len(true_ns))
        clock, live_ns = NicClock(), np.empty(len(true_ns))
        for n, (stamp_us, now_ns) in enumerate(zip(stamps_us, true_ns + late_ns, strict=True)):
            live_ns[n] = clock.update(int(stamp_us), int(now_ns))
        settled = (true_ns - true_ns[0] > 20e9) & (live_ns < true_ns + late_ns)
        assert np.abs(live_ns - true_ns)[settled].max() < 0.2e6, seed
        leg = slice(-480, None)  # four seconds
        assert np.abs(clock.host_ns(stamps_us[leg].astype(np.uint32)) - true_ns[leg]).max() < 0.1e6, seed


def test_a_host_clock_that_is_slewed_is_followed_and_what_was_before_forgotten() -> None:
    """Three times as fast as a line may rise, for a minute."""
    clock, rng = NicClock(), np.random.default_rng(5)
    nic_s = np.arange(0.0, 110.0, 0.01)
    true_s = 50.0 + nic_s + 300e-6 * np.clip(nic_s - 30, 0, 60)
    read_s = true_s + rng.uniform(0, 5e-3, len(nic_s))
    mapped_s = 1e-9 * np.array(
        [clock.update(int(t * 1e6), int(read * 1e9)) for t, read in zip(nic_s, read_s, strict=True)]
    )
    assert clock.resets == 0
    assert np.abs(mapped_s - true_s)[nic_s > 5].max() < 4.5e-3  # 200 ppm of twenty seconds and some; of forty it is 8
    assert np.abs(mapped_s - true_s)[nic_s > 105].max() < 0.3e-3


def test_a_host_that_stalls_for_seconds_forgets_nothing() -> None:
    clock = NicClock()
    nic_s = np.arange(0.0, 60.0, 0.01)
    read_s = 50.0 + nic_s + np.where((nic_s > 45) & (nic_s < 53), 53 - nic_s, 0.0)
    mapped_s = [1e-9 * clock.update(int(t * 1e6), int(read * 1e9)) for t, read in zip(nic_s, read_s, strict=True)]
    assert clock.resets == 0
    assert np.abs(np.subtract(mapped_s, 50.0 + nic_s)).max() < 10e-6
    assert clock.span_s > 38


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("what", "found"),
    [
        ("nothing", None),
        ("stall", None),
        ("slew", None),
        ("wrong stamps", None),
        ("card reset", None),
        ("session", None),
        ("back 0.05", -0.05),
        ("back 1.5", -1.5),
        ("forward 0.02", 0.02),
        ("forward 9e8", 9e8),
    ],
)
def test_only_a_host_clock_that_was_set_is_a_step(what: str, found: float | None, seed: int) -> None:
    rng = np.random.default_rng(seed)
    t_s = np.sort(rng.uniform(0, 20, 2400))
    nic_us, host_s = t_s * 1e6 + 4_290_000_000, 1.7e9 + t_s + rng.exponential(0.002, t_s.size)
    late = t_s > 9
    match what.split():
        case ["stall"]:
            held = (t_s > 9) & (t_s < 10)
            host_s[held] = 1.7e9 + 10
        case ["slew"]:
            host_s += 5e-4 * t_s
        case ["wrong", _]:
            host_s[700], nic_us[1300] = host_s[700] - 1.0, nic_us[1300] + 5e6
        case ["card", _]:
            nic_us[late] -= nic_us[late][0] - 100
        case ["session"]:
            host_s[late] += 14_000
            nic_us[late] += 500e6
        case ["back" | "forward", _]:
            assert found is not None
            host_s[late] += found
    step = host_step((np.rint(nic_us).astype(np.int64) % WRAP_US).astype(np.uint32), host_s)
    if found is None:
        assert step is None
        return
    assert step is not None
    assert step[1] == pytest.approx(found, abs=8e-3)
    assert abs(step[0] - int(np.argmax(late))) < 250
