"""The vehicle's clock from messages with all sorts of delays, and the two things it tells."""

from __future__ import annotations

import json
import random

import pytest

from companion.autopilot.telemetry import Telemetry
from companion.autopilot.vehicle_clock import Turn, VehicleClock
from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode
from tests.unit.companion.autopilot.telemetry_bench import HEARTBEAT, POSITION, TelemetryBench

_NOW_NS, _OWN_NS, _MS = 6844 * NS_PER_S, 57 * NS_PER_S, 1_000_000
_WRAP_MS = 1 << 32
"""49.7 days: after so long `time_boot_ms` begins again."""


def test_the_offset_is_that_of_the_least_delayed_message() -> None:
    clock, rng = VehicleClock(), random.Random(1)
    for count in range(200):
        delay_ns = rng.choice((400_000, 3 * _MS, 30 * _MS, 200 * _MS))
        assert clock.told(_OWN_NS + count * 20 * _MS, _NOW_NS + count * 20 * _MS + delay_ns) is None
        assert (clock.at(_NOW_NS) is None) == (count < 9), "one message alone may have been held up"
    assert clock.at(_NOW_NS) == pytest.approx(_OWN_NS, abs=4 * _MS)


@pytest.mark.parametrize("rate", [0.985, 1.0, 1.015])
def test_a_clock_of_another_rate_is_followed(rate: float) -> None:
    clock, rng = VehicleClock(), random.Random(2)
    for count in range(6000):
        t_ns = count * 10 * _MS
        delay_ns = _MS // 2 + (rng.random() < 0.2) * 40 * _MS
        assert clock.told(_OWN_NS + round(rate * t_ns), _NOW_NS + t_ns + delay_ns) is None
        if count > 100:
            assert clock.at(_NOW_NS + t_ns) == pytest.approx(_OWN_NS + rate * t_ns, abs=5 * _MS)


def test_a_step_back_is_a_restart_and_forgets_the_offset() -> None:
    clock = VehicleClock()
    for count in range(20):
        assert clock.told(_OWN_NS + count, _NOW_NS + count) is None
    assert clock.told(_OWN_NS - 200 * _MS, _NOW_NS + 100) is None, "out of order"
    assert clock.told(3 * NS_PER_S, _NOW_NS + NS_PER_S) is Turn.RESTARTED
    assert clock.offset_ns is None
    assert clock.told(3 * NS_PER_S + 20 * _MS, _NOW_NS + NS_PER_S + 20 * _MS) is None


def test_a_leap_ahead_is_our_own_standstill_and_a_queue_that_empties_is_none() -> None:
    clock, now_ns, own_ns = VehicleClock(), _NOW_NS, _OWN_NS
    for _ in range(200):
        now_ns, own_ns = now_ns + 20 * _MS, own_ns + 20 * _MS
        assert clock.told(own_ns, now_ns) is None
    now_ns += 2 * NS_PER_S  # the program stood still, its clock did not: a queue of old messages
    for count in range(100):
        own_ns += 20 * _MS
        assert clock.told(own_ns, now_ns + count * 1000) is None
    own_ns += 5 * NS_PER_S
    assert clock.told(own_ns, now_ns + 20 * _MS) is Turn.LEAPT
    assert clock.stood_still_ns == pytest.approx(5 * NS_PER_S, abs=NS_PER_S // 5)
    assert clock.at(now_ns + 20 * _MS) == own_ns


def test_nothing_has_stood_still_at_the_beginning() -> None:
    assert VehicleClock().stood_still_ns == 0


@pytest.mark.parametrize(("back_ns", "turn"), [(NS_PER_S, None), (NS_PER_S + 1, Turn.RESTARTED)])
def test_a_step_back_of_more_than_a_second_is_a_restart(back_ns: int, turn: Turn | None) -> None:
    clock = VehicleClock()
    assert clock.told(_OWN_NS, _NOW_NS) is None
    assert clock.told(_OWN_NS - back_ns, _NOW_NS + 1) is turn, "as early as at the second message"


@pytest.mark.parametrize(("leap_ns", "turn"), [(300 * _MS, None), (300 * _MS + 1, Turn.LEAPT)])
@pytest.mark.parametrize("first_ns", [_NOW_NS, 900 * _MS, NS_PER_S])
def test_more_than_a_third_of_a_second_is_a_leap(first_ns: int, leap_ns: int, turn: Turn | None) -> None:
    clock = VehicleClock()
    clock.told(_OWN_NS, first_ns)
    later_ns = first_ns + 3 * NS_PER_S // 2
    assert clock.told(_OWN_NS + 3 * NS_PER_S // 2 + leap_ns, later_ns) is turn
    assert clock.stood_still_ns == (0 if turn is None else leap_ns)


@pytest.mark.parametrize("first_ns", [0, 900 * _MS, NS_PER_S, _NOW_NS])
@pytest.mark.parametrize(
    ("after_ns", "turn"), [(200 * _MS, None), (NS_PER_S, None), (NS_PER_S + 1, Turn.LEAPT), (2 * NS_PER_S, Turn.LEAPT)]
)
def test_within_a_second_of_the_first_message_there_is_no_leap(first_ns: int, after_ns: int, turn: Turn | None) -> None:
    clock = VehicleClock()
    clock.told(_OWN_NS, first_ns)
    assert clock.told(_OWN_NS + after_ns + 400 * _MS, first_ns + after_ns) is turn


@pytest.mark.parametrize("first_ns", [100 * _MS, _NOW_NS])
def test_a_later_message_counts_unless_it_was_delayed_by_more_than_the_clocks_may_drift(first_ns: int) -> None:
    """After a second by 20 ms, whatever our own clock shows."""
    for delay_ns, counts in ((20 * _MS, True), (20 * _MS + 1, False), (19 * _MS, True)):
        clock = VehicleClock()
        for _ in range(10):
            clock.told(_OWN_NS, first_ns)
        clock.told(_OWN_NS + NS_PER_S - delay_ns, first_ns + NS_PER_S)
        assert clock.offset_ns == _OWN_NS - first_ns - (delay_ns if counts else 0)


@pytest.mark.parametrize("own_s", [-5, 0, 57])
def test_the_first_message_is_no_restart_whatever_time_it_tells(own_s: int) -> None:
    assert VehicleClock().told(own_s * NS_PER_S, _NOW_NS) is None


def _restarted(at_ns: list[int]) -> VehicleClock:
    """A clock that stepped back at each of these times of ours."""
    clock = VehicleClock()
    for one_ns in at_ns:
        clock.told(_OWN_NS, one_ns)
        assert clock.told(0, one_ns) is Turn.RESTARTED
    return clock


@pytest.mark.parametrize("begin_ns", [1, _NOW_NS])
@pytest.mark.parametrize(
    ("after_s", "are_two"),
    [
        ((0, 1, 2, 3, 4.999_999_999), True),
        ((0, 1, 2, 3, 5), False),
        ((0, 1, 2, 3, 8), False),
        ((0, 2, 2.1, 2.2, 5), False),
        ((0, 1, 2, 3), False),
        ((0, 10, 11, 12, 13, 14), True),  # that of long ago is one vehicle's own
    ],
)
def test_five_restarts_within_five_seconds_are_two_vehicles(
    begin_ns: int, after_s: tuple[float, ...], are_two: bool
) -> None:
    at_ns = [begin_ns + round(one_s * NS_PER_S) for one_s in after_s]
    assert _restarted(at_ns).is_of_two(at_ns[-1]) is are_two


@pytest.mark.parametrize("begin_ns", [100 * _MS, _NOW_NS])
def test_two_vehicles_are_told_for_five_seconds_after_the_last_restart(begin_ns: int) -> None:
    clock, last_ns = _restarted([begin_ns + n * 100 * _MS for n in range(5)]), begin_ns + 400 * _MS
    for later_ns, are_two in ((1, True), (5 * NS_PER_S - 1, True), (5 * NS_PER_S, False), (9 * NS_PER_S, False)):
        assert clock.is_of_two(last_ns + later_ns) is are_two


@pytest.mark.parametrize("rounds", [0.5, 1.0, 1.5, 1.75, 2.0])
def test_a_count_of_32_bits_goes_on_however_its_messages_are_delayed(rounds: float) -> None:
    """From a second before it has gone round so often, for two; what the vehicle's clock is was heard before."""
    clock, begin_ms = VehicleClock(), round(rounds * _WRAP_MS) - 1000
    clock.told(begin_ms * _MS, _NOW_NS + 30 * _MS)
    for step in range(1, 100):
        own_ms, delay_ms = begin_ms + 20 * step, (45, 1, 12)[step % 3]
        now_ns = _NOW_NS + (20 * step + delay_ms) * _MS
        assert clock.unwrapped(own_ms % _WRAP_MS, now_ns) == own_ms
        assert clock.told(own_ms * _MS, now_ns) is None


def test_a_count_that_began_again_is_the_same_boots_within_a_minute_of_where_it_should_be() -> None:
    """It should be at 100 s. A vehicle that has truly restarted is that near to it by chance alone."""
    clock = VehicleClock()
    clock.told((_WRAP_MS + 100_000) * _MS, _NOW_NS)
    for boot_ms in (40_001, 100_000, 159_999):
        assert clock.unwrapped(boot_ms, _NOW_NS) == _WRAP_MS + boot_ms
    for boot_ms in (40_000, 160_000, 5_000_000, _WRAP_MS // 2):
        assert clock.unwrapped(boot_ms, _NOW_NS) == boot_ms, "it has restarted"


@pytest.mark.parametrize("on_ms", [1 << 30, 1 << 31, 3 << 30])
def test_a_restart_after_a_part_of_the_49_days_is_one(on_ms: int) -> None:
    """After 12, 25 and 37 days the count has not begun again by itself."""
    clock = VehicleClock()
    clock.told(on_ms * _MS, _NOW_NS)
    later_ns = _NOW_NS + 5 * NS_PER_S
    assert clock.unwrapped(4_000, later_ns) == 4_000
    assert clock.told(4_000 * _MS, later_ns) is Turn.RESTARTED


def test_beside_a_vehicle_just_started_another_ones_count_near_its_end_is_as_told() -> None:
    """Two of one system id: no clock is before its own beginning."""
    clock = VehicleClock()
    clock.told(NS_PER_S, _NOW_NS)
    assert clock.unwrapped(_WRAP_MS - 1000, _NOW_NS) == _WRAP_MS - 1000


@pytest.fixture
def bench() -> TelemetryBench:
    return TelemetryBench()


def _stamped(bench: TelemetryBench, vehicle_ms: int, ours_s: float) -> None:
    """A position that left at `vehicle_ms` of the vehicle's clock and arrives at `ours_s` of ours."""
    bench.now_ns = round(ours_s * 1e9)
    bench.take("LOCAL_POSITION_NED", POSITION | {"time_boot_ms": vehicle_ms})


@pytest.mark.parametrize("name", ["LOCAL_POSITION_NED", "ATTITUDE"])
def test_its_clock_is_known_by_the_milliseconds_of_its_messages(bench: TelemetryBench, name: str) -> None:
    assert bench.telemetry.vehicle_ns(10_000_000_000) is None and bench.telemetry.state().clock_offset_ns is None
    for step in range(10):
        bench.now_ns = 10_000_000_000 + step * 20_000_000
        bench.take(name, POSITION | {"yaw": 0.0, "time_boot_ms": 57_000 + 20 * step})
    assert bench.telemetry.state().clock_offset_ns == 47_000_000_000
    assert bench.telemetry.vehicle_ns(11_000_000_000) == 58_000_000_000
    assert bench.telemetry.state().boot_ms == 57_180


def test_its_questions_for_our_time_tell_its_own(bench: TelemetryBench) -> None:
    asked: list[int] = []
    telemetry = Telemetry(lambda: bench.now_ns, on_time_question=asked.append)
    for step in range(10):
        bench.now_ns = 10_000_000_000 + step * 100_000_000
        telemetry.take("TIMESYNC", 1, json.dumps({"tc1": 0, "ts1": 57_000_000_123 + step * 100_000_000}))
    assert asked[0] == 57_000_000_123 and len(asked) == 10
    assert telemetry.state().clock_offset_ns == 47_000_000_123
    assert telemetry.state().timesync_mono_ns == bench.now_ns
    bench.now_ns += 1_000_000
    telemetry.take("TIMESYNC", 1, json.dumps({"tc1": 1, "ts1": 5}))
    assert len(asked) == 10 and telemetry.state().timesync_mono_ns == bench.now_ns - 1_000_000, "an answer is none"


def test_a_restart_is_told_and_what_was_known_is_forgotten(bench: TelemetryBench) -> None:
    bench.now_ns = 1_000_000_000
    bench.telemetry.identify(7)
    bench.take("HEARTBEAT", HEARTBEAT)
    bench.take("BATTERY_STATUS", {"id": 0, "battery_remaining": 42})
    bench.take("EXTENDED_SYS_STATE", {"landed_state": 2})
    bench.take("PARAM_VALUE", {"param_id": "A", "param_value": 1.5, "param_type": 9})
    bench.take("COMMAND_ACK", {"command": 176, "result": 0})
    for boots in (1, 2, 3):
        _stamped(bench, 57_000, 2.0 * boots)
        assert bench.telemetry.take_events() == []
        _stamped(bench, 1_400, 2.0 * boots + 1.0)
        state = bench.telemetry.state()
        assert state.boots == boots and state.boot_ms == 1_400
        assert state.landed_unknown and not state.in_air, "it flew before"
        (event,) = bench.telemetry.take_events()
        assert event.text == "the autopilot has restarted: its clock is at 1.4 s again" and event.severity == 4
        assert event.t_mono_ns == bench.now_ns
    assert (state.system_id, state.autopilot, state.heartbeat_mono_ns) == (7, "px4", 1_000_000_000)
    assert state.mode is None and not state.armed and state.battery_remaining is None
    assert bench.telemetry.parameters == {} and bench.telemetry.acknowledgements == {}


def test_a_pause_of_ours_is_told_and_nothing_is_forgotten(bench: TelemetryBench) -> None:
    bench.take("HEARTBEAT", HEARTBEAT)
    for step in range(30):
        _stamped(bench, 57_000 + 100 * step, 10.0 + 0.1 * step)
    assert bench.telemetry.take_events() == []
    _stamped(bench, 57_000 + 3_000 + 2_600, 13.0)
    (event,) = bench.telemetry.take_events()
    assert event.text == "our clock stood still: the autopilot's went on by 2.6 s" and event.severity == 4
    state = bench.telemetry.state()
    assert state.stood_still_ns == 2_600_000_000 and state.boots == 0 and state.mode is FlightMode.OFFBOARD


def test_two_vehicles_of_one_system_id_are_known_by_their_clocks(bench: TelemetryBench) -> None:
    for n in range(100):
        _stamped(bench, 100_000 + 20 * n + (60_000 if n % 2 else 0), 50.0 + 0.02 * n)
    assert bench.telemetry.state().are_two
    texts = [event.text for event in bench.telemetry.take_events()]
    assert texts.count("two vehicles of one system id: their clocks alternate") == 1
    assert len(texts) == 5  # four restarts came before it
    bench.now_ns += 5_000_000_000
    assert not bench.telemetry.state().are_two


def test_a_vehicle_that_restarts_twice_is_one(bench: TelemetryBench) -> None:
    for at_s, vehicle_ms in [(1.0, 60_000), (2.0, 500), (3.0, 1500), (4.0, 100), (5.0, 1100)]:
        _stamped(bench, vehicle_ms, at_s)
    assert not bench.telemetry.state().are_two and bench.telemetry.state().boots == 2


@pytest.mark.parametrize("begins_ms", [(1 << 32) - 1000, 1 << 32, (3 << 32) + 5_000_000])
def test_fault_63_a_count_of_32_bits_that_begins_again_is_no_restart(begins_ms: int) -> None:
    """time_boot_ms after 49.7 days, beside a TIMESYNC that goes on; also for who connects only then."""
    bench = TelemetryBench()
    for step in range(200):
        bench.now_ns += 10 * _MS
        own_ms = begins_ms + 10 * step
        bench.take("TIMESYNC", {"tc1": 0, "ts1": own_ms * _MS})
        bench.take("LOCAL_POSITION_NED", POSITION | {"time_boot_ms": own_ms & 0xFFFFFFFF})
        bench.take("ATTITUDE", {"yaw": 0.0, "time_boot_ms": own_ms & 0xFFFFFFFF})
    state = bench.telemetry.state()
    assert (state.boots, state.are_two, state.stood_still_ns, bench.telemetry.take_events()) == (0, False, 0, [])
    assert bench.telemetry.vehicle_ns(bench.now_ns) == pytest.approx((begins_ms + 1990) * _MS, abs=2 * _MS)
    bench.now_ns += 20 * _MS
    bench.take("ATTITUDE", {"yaw": 0.0, "time_boot_ms": 120_000})
    assert bench.telemetry.state().boots == 1, "a restart is one still"


def test_without_timesync_a_count_that_begins_again_goes_on_too() -> None:
    clock, ms = VehicleClock(), (1 << 32) - 400
    for step in range(100):
        now_ns, own_ms = _NOW_NS + 20 * step * _MS, ms + 20 * step
        whole_ms = clock.unwrapped(own_ms & 0xFFFFFFFF, now_ns)
        assert whole_ms == own_ms
        assert clock.told(whole_ms * _MS, now_ns) is None
