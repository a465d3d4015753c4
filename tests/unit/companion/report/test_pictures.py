"""Pictures of a report."""

from __future__ import annotations

import numpy as np

from companion.analysis.exchanges import PacketTimes
from companion.report.pictures import recording_rates


def test_the_rates_of_a_recording_whose_clock_was_set_are_those_of_the_longer_part() -> None:
    t_s = np.asarray(np.arange(0.0, 10.0, 0.01), np.float64)
    before_s = t_s[:200] - 1.6e9  # from 1970
    alone, set_ = PacketTimes(t_s, t_s[100:]), PacketTimes(np.concatenate([before_s, t_s]), t_s[100:])
    assert recording_rates([("tx1", alone)]) == recording_rates([("tx1", set_)])
