"""Time stands still while one input is handled, and every input has a number."""

from __future__ import annotations

from companion.core.event_clock import EventClock
from tests.manual_clock import ManualClock


async def test_the_clock_stands_still_inside_an_event_and_goes_on_outside() -> None:
    base = ManualClock(100)
    clock = EventClock(base)
    assert not clock.is_held
    with clock.event() as t_ns:
        base.advance(1e-9)
        assert (t_ns, clock.now_ns(), clock.is_held) == (100, 100, True)
        with clock.event(7) as inner_ns:  # a part of the same event
            assert (inner_ns, clock.now_ns(), clock.number) == (100, 100, 1)
        assert clock.is_held
    assert clock.now_ns() == 101
    with clock.event(50):
        assert (clock.now_ns(), clock.number) == (50, 2)
    await clock.sleep_until_ns(500)
    assert clock.now_ns() == 500


def test_an_event_ends_when_its_handler_raises() -> None:
    clock = EventClock(ManualClock(1))
    try:
        with clock.event():
            raise ValueError
    except ValueError:
        pass
    assert not clock.is_held


def test_a_replay_counts_as_its_log_does() -> None:
    clock = EventClock(ManualClock(1))
    clock.count_from(7)
    for number in (7, 8):
        with clock.event():
            assert clock.number == number
