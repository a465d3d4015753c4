"""A rover's set points, and the path under them: in the plane, and bent so that both sides of it are told apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.config.schema import MissionConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint, Vector3
from companion.guidance.approach import Approach
from companion.guidance.ground import in_plane
from companion.guidance.steering import Aim
from companion.safety.gate import GateLimits

_LIMITS = GateLimits(
    fence_min_m=(-50, -50, -1), fence_max_m=(50, 50, 10), fence_radius_m=60.0, max_speed_m_s=1.0, max_climb_m_s=0.7,
    max_acceleration_m_s2=3.0, min_height_m=0.5, on_ground=True,
)  # fmt: skip
_HERE: Vector3 = (3.0, -2.0, 0.1)


def test_it_is_told_a_velocity_in_the_plane_and_to_stand_a_place() -> None:
    moving = in_plane(Setpoint(7, None, (0.3, -0.1, 0.2), 1.0), _HERE)
    assert moving == Setpoint(7, None, (0.3, -0.1, 0.0), None)
    standing = in_plane(Setpoint(7, None, (0.03, -0.03, 0.4), 1.0), _HERE)
    assert standing == Setpoint(7, _HERE, (0.0, 0.0, 0.0), None)


def _path(aim: Aim | None) -> np.ndarray:
    approach = Approach(MissionConfig(vehicle="rover", acceleration_m_s2=0.4), _LIMITS, 1.2)
    approach.start((0.0, 0.0, 0.1), 0.0, 0.1)
    places = [approach.setpoint(tick * NS_PER_S // 20, aim, True).p_local_enu_m for tick in range(300)]
    return np.array(places)


@pytest.mark.parametrize("aim", [Aim(0.5, 20.0, 8.0, 0.2), Aim(0.5, 20.0, 0.5, 1.0), None])
def test_its_path_stays_level_and_is_no_line(aim: Aim | None) -> None:
    path_m = _path(aim)
    assert np.ptp(path_m[:, 2]) == 0.0, "and nothing of the least height lifts it"
    newest_m = path_m[-60:, :2] - path_m[-60:, :2].mean(axis=0)
    along, across = np.linalg.svd(newest_m, compute_uv=False) / math.sqrt(len(newest_m))
    assert along > 0.2 and across > 0.01
