"""Where a target can be flown to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.guidance.reach import Reach
from companion.safety.gate import GateLimits


@pytest.mark.parametrize("yaw_deg", [0.0, 25.0, -140.0])
def test_a_fence_and_the_range_of_arrival_beyond_it(yaw_deg: float) -> None:
    limits = GateLimits(
        fence_min_m=(-3.0, -4.0, -1.0),
        fence_max_m=(12.0, 4.0, 3.0),
        fence_radius_m=11.0,
        fence_yaw_deg=yaw_deg,
        max_speed_m_s=1.0,
        max_climb_m_s=0.7,
        max_acceleration_m_s2=3.0,
        min_height_m=0.5,
    )
    own_m = np.array([[5.0, 5.9, 1.0], [5.0, 6.1, 1.0], [-4.9, 0.0, 1.0], [-5.1, 0.0, 1.0], [0.0, 0.0, 5.1],
                      [12.9, 1.0, 0.5], [13.1, 1.0, 0.5]])  # fmt: skip
    c, s = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    enu_m = own_m @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    # The last but one is inside the cylinder and what is allowed beyond it, the last is not.
    assert Reach(limits, 2.0)(enu_m).tolist() == [True, False, True, False, False, True, False]
