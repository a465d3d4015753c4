"""From leg to leg: the yaw, the velocity back to the path, and where it stands after a refusal."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest

from companion.config.schema import MissionConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint
from companion.guidance.approach import Approach, as_velocity, inside
from companion.safety.gate import GateLimits


class _Still:
    """A SAR that is never done, so that the approach stays on its leg."""

    is_waiting = True

    def begin(self) -> None:
        pass

    def finish(self, end_ns: int) -> None:
        pass


@pytest.mark.parametrize(("yaw", "ends_at"), [("fixed", 0.3), ("target", 1.8)])
def test_the_nose_is_kept_or_turned_slowly_to_the_target(yaw: str, ends_at: float) -> None:
    approach = Approach(_Still(), MissionConfig(yaw=yaw), 1.2, 0.3)  # type: ignore[arg-type]
    approach.start((0.0, 0.0, 1.5), 0.3)
    yaws = []
    for tick in range(100):
        setpoint = approach.setpoint(tick * NS_PER_S // 20, 1.8, True)
        assert setpoint.yaw_enu_rad is not None
        yaws.append(setpoint.yaw_enu_rad)
    assert yaws[0] == pytest.approx(0.3) and yaws[-1] == pytest.approx(ends_at)
    assert max(abs(b - a) for a, b in itertools.pairwise(yaws)) <= math.radians(30) / 20 + 1e-9


def test_a_velocity_leads_back_to_the_path_within_the_limits() -> None:
    limits = GateLimits((-9, -9, -1), (9, 9, 9), 9.0, max_speed_m_s=1.0, max_climb_m_s=0.5, max_acceleration_m_s2=3.0, min_height_m=0.5)  # fmt: skip # noqa: E501
    path = Setpoint(7, (1.0, 2.0, 1.5), (0.5, 0.0, 0.0), 0.3)
    assert as_velocity(path, (1.0, 2.0, 1.5), limits) == Setpoint(7, None, (0.5, 0.0, 0.0), 0.3)
    back = as_velocity(path, (1.0, 2.5, 1.4), limits)
    assert back.v_local_enu_m_s == pytest.approx((0.5, -0.4, 0.08))
    far = as_velocity(path, (1.0, -50.0, 30.0), limits)
    assert math.hypot(*far.v_local_enu_m_s[:2]) == pytest.approx(1.0) and far.v_local_enu_m_s[2] == -0.5


def test_after_a_refusal_it_stands_inside_the_fence() -> None:
    limits = GateLimits((-9, -4, -1), (9, 4, 5), 6.0, max_speed_m_s=1.0, max_climb_m_s=0.5, max_acceleration_m_s2=3.0, min_height_m=0.5)  # fmt: skip # noqa: E501
    assert inside((1.0, 2.0, 1.5), limits) == pytest.approx((1.0, 2.0, 1.5))
    assert inside((0.0, 5.0, 1.5), limits) == pytest.approx((0.0, 3.7, 1.5))
    assert inside((7.0, 0.0, 1.5), limits) == pytest.approx((5.7, 0.0, 1.5))
    assert inside((0.0, 0.0, 9.0), limits)[2] == pytest.approx(4.7)
    assert inside((0.0, 0.0, 0.1), limits)[2] == pytest.approx(0.8)
    narrow = replace(limits, fence_min_m=(-0.1, -4, -1), fence_max_m=(0.1, 4, 5))
    assert inside((3.0, 1.0, 1.5), narrow) == pytest.approx((0.0, 1.0, 1.5))
