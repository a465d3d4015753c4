"""Several batteries as one figure."""

from __future__ import annotations

import pytest

from companion.autopilot.batteries import Batteries, Charge
from companion.core.clock import NS_PER_S

_NOW_NS = 12 * NS_PER_S


def test_the_lowest_of_all_that_are_fresh_counts() -> None:
    batteries = Batteries()
    assert batteries.now(_NOW_NS) == Charge(None, None, ())
    batteries.take(0, 0.95, _NOW_NS)
    batteries.take(1, 0.05, _NOW_NS + 1)
    batteries.take(2, 0.0, _NOW_NS + 2)
    assert batteries.now(_NOW_NS + 3) == Charge(0.0, _NOW_NS + 2, ())
    batteries.take(2, None, _NOW_NS + 4)
    assert batteries.now(_NOW_NS + 5) == Charge(0.0, _NOW_NS + 4, (2,)), "what it told last still counts"


@pytest.mark.parametrize("charge", [None, 0.9])
def test_one_that_falls_silent_does_not_raise_the_figure(charge: float | None) -> None:
    batteries = Batteries()
    batteries.take(0, 0.95, _NOW_NS)
    batteries.take(1, 0.22, _NOW_NS)
    later_ns = _NOW_NS + 9 * NS_PER_S
    batteries.take(0, 0.95, later_ns)
    assert batteries.now(later_ns) == Charge(0.22, _NOW_NS, (1,))
    batteries.take(1, charge, later_ns)
    assert batteries.now(later_ns) == Charge(charge or 0.22, later_ns, () if charge else (1,))


@pytest.mark.parametrize("times", [1, 100])
def test_one_that_is_silent_for_5_s_tells_nothing_any_more(times: int) -> None:
    """However long the clock has run: ages are differences."""
    batteries = Batteries()
    told_ns = times * _NOW_NS
    batteries.take(3, 0.5, told_ns)
    assert batteries.now(told_ns + 5 * NS_PER_S - 1) == Charge(0.5, told_ns, ())
    assert batteries.now(told_ns + 5 * NS_PER_S) == Charge(None, told_ns, (3,))
    assert batteries.now(told_ns + 40 * NS_PER_S) == Charge(None, told_ns, (3,))


def test_without_any_figure_it_is_known_when_the_newest_was_heard() -> None:
    batteries = Batteries()
    batteries.take(7, None, _NOW_NS + 9)
    batteries.take(4, None, _NOW_NS)
    assert batteries.now(_NOW_NS + 10) == Charge(None, _NOW_NS + 9, (4, 7))
