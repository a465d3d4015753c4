"""What `doctor radio --rest` says of exchanges between robots that stand, and of such that do not."""

from __future__ import annotations

import numpy as np

from companion.core.clock import NS_PER_S
from companion.diagnosis.coherence import _at_rest
from companion.neighbours.neighbour import Neighbour
from companion.sensing.window import SarWindow
from tests.ax_leg import FIRST_NS, flown
from tests.leg_scene import LEVER_M
from tests.sim_scenes import straight
from wsr.channel import wavelength_m

STILL = straight(np.array([0.0, 0.0, 1.5]), np.zeros(3), 1.0, 2.0, yaw_rad=0.0)
AWAY = straight(np.array([9.0, 2.0, 0.5]), np.zeros(3), 1.0, 2.0, yaw_rad=0.0)


def test_standing_robots_are_coherent_and_moving_ones_are_not() -> None:
    window, neighbour, _ = flown(80, STILL, AWAY)
    check = _at_rest(window, neighbour, FIRST_NS, FIRST_NS + 3 * NS_PER_S)
    assert (check.name, check.ok) == ("phase at rest to beacon", True), check
    assert float(check.found.split()[2]) < 6.0
    window, neighbour, _ = flown(20)
    check = _at_rest(window, neighbour, FIRST_NS, FIRST_NS + 3 * NS_PER_S)
    assert check.ok is False and "do both robots stand" in check.remedy


def test_without_packets_or_datagrams_nothing_is_judged() -> None:
    empty = SarWindow(antenna_m=LEVER_M, wavelength_m=wavelength_m(108), min_packets=1, max_pose_gap_s=1.0)
    silent = _at_rest(empty, Neighbour(2, "beacon"), 0, NS_PER_S)
    assert silent.ok is None and "datagrams do not arrive" in silent.found
    _, neighbour, _ = flown(20, STILL, AWAY)
    assert "no packets of beacon" in _at_rest(empty, neighbour, 0, NS_PER_S).found
