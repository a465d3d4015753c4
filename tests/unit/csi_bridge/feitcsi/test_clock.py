"""Both clocks of a card, in the public captures."""

from __future__ import annotations

import numpy as np

from csi_bridge.feitcsi.clock import fine_us, unwrapped_us
from tests.unit.csi_bridge.feitcsi.captures import EACH, capture

pytestmark = EACH


def test_both_clocks_agree_to_a_few_microseconds(name: str) -> None:
    records = capture(name).records
    stamps = np.array([record.timestamp_low_us for record in records], np.uint32)
    ticks = np.array([record.ftm_ticks for record in records], np.uint32)
    off = fine_us(ticks, stamps) - unwrapped_us(stamps)
    assert np.ptp(off) < 4.5
    assert (np.diff(fine_us(ticks, stamps)) > 0).all()
