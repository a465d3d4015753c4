"""How an autopilot's estimate wanders in flight."""

from __future__ import annotations

import numpy as np
import pytest

from companion.sim.px4.wander import WANDER_M, Wander


def test_an_estimate_wanders_slowly_and_as_far_as_it_should() -> None:
    ways_m = []
    for seed in range(40):
        wander = Wander(seed)
        ways_m.append([wander.step(0.025) for _ in range(2400)])
    off_m = np.array(ways_m)
    assert np.std(off_m[:, 1200:], axis=(0, 1)) == pytest.approx(WANDER_M, rel=0.25)
    assert np.abs(off_m[:, :40, 2]).max() < 0.02, "a height is known on the ground"
    assert np.abs(np.diff(off_m, axis=1)).max() < 0.005, "nothing that a controller would shake by"
