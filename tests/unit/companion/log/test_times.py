"""Memory by messages, not by the years between them."""

from __future__ import annotations

import numpy as np

from companion.log.times import bin_edges_s, main_span_ns, per_second

_S = 1_000_000_000


def test_the_stretch_that_most_messages_are_of_is_found() -> None:
    flight = [1_700_000_000 * _S + number * _S // 10 for number in range(1000)]
    assert main_span_ns(flight) is None
    assert main_span_ns([]) is None
    assert main_span_ns([0, *flight, 1 << 63]) == (flight[0], flight[-1])
    old = [number * _S for number in range(999)]  # a robot whose clock was never set
    assert main_span_ns([*old, *flight]) == (flight[0], flight[-1])


def test_a_long_span_has_no_more_bins_than_a_day_of_seconds() -> None:
    assert bin_edges_s(2.9).tolist() == [0.0, 1.0, 2.0]
    assert bin_edges_s(0.1).tolist() == [0.0, 1.0]
    assert len(bin_edges_s(1.7e9)) < 200_000
    at_s, rates = per_second(np.arange(0, 1e6, 2.0).tolist(), 1e6)
    assert len(at_s) <= 100_001
    assert np.allclose(rates[:-1], 0.5)
