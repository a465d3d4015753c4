"""The logged truth between its samples."""

from __future__ import annotations

import numpy as np

from companion.log.records import TruthTrack
from companion.log.truth import Truth


def test_the_truth_is_interpolated_and_knows_its_limits() -> None:
    track = TruthTrack(
        [Truth(0, (0.0, 0.0, 0.0), {"b": (1.0, 0.0, 0.0)}), Truth(10, (0.0, 0.0, 0.0), {"b": (1.0, 2.0, 0.0)})]
    )
    bearing = track.bearing(5, "b")
    assert bearing is not None
    np.testing.assert_allclose(bearing, (np.pi / 4, np.pi / 2))
    assert track.bearing(11, "b") is None
    assert track.bearing(5, "nobody") is None
    assert not TruthTrack(())
