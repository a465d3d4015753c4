"""Heights and paths of PX4's own modes."""

from __future__ import annotations

import pytest

from companion.core.messages import Vector3
from companion.sim.px4.navigator import Return, is_outside_fence, landing, return_height_m
from companion.sim.px4.parameters import DEFAULTS, Parameters

_HOME: Vector3 = (1.0, 1.0, 0.0)


def _with(**changed: float) -> Parameters:
    return DEFAULTS | changed


@pytest.mark.parametrize(
    ("up_m", "sink_m_s"), [(1.0, 0.7), (5.0, 0.7), (7.5, 1.1), (10.0, 1.5), (50.0, 1.5)]
)  # fmt: skip
def test_landing_is_slow_near_the_ground(up_m: float, sink_m_s: float) -> None:
    demand = landing((0.0, 0.0, up_m), _HOME, (3.0, 4.0), 0.7)
    assert demand.p_enu_m == (3.0, 4.0, None)
    assert demand.v_enu_m_s == pytest.approx((0.0, 0.0, -sink_m_s))


@pytest.mark.parametrize(
    ("away_m", "up_m", "cone_deg", "height_m"),
    [
        (50.0, 2.0, 45.0, 30.0),
        (8.0, 2.0, 45.0, 8.0),
        (3.0, 2.0, 45.0, 4.0),
        (1.0, 1.0, 45.0, 2.0),
        (1.0, 5.0, 45.0, 5.0),
        (8.0, 2.0, 0.0, 30.0),
        (8.0, 60.0, 45.0, 60.0),
    ],
)
def test_it_returns_at_the_height_of_its_cone_and_never_lower_than_it_is(
    away_m: float, up_m: float, cone_deg: float, height_m: float
) -> None:
    """RTL_RETURN_ALT 30, RTL_MIN_DIST 10, NAV_ACC_RAD 2."""
    parameters = _with(RTL_CONE_ANG=cone_deg)
    assert return_height_m((1.0 + away_m, 1.0, up_m), _HOME, parameters) == pytest.approx(height_m)


def test_a_return_climbs_goes_over_and_lands() -> None:
    one = Return((21.0, 1.0, 2.0), _HOME, _with(RTL_RETURN_ALT=10.0))
    assert one.demand((21.0, 1.0, 2.0)).p_enu_m == (21.0, 1.0, 10.0), "up where it began"
    assert one.demand((21.0, 1.0, 9.5)).p_enu_m == (1.0, 1.0, 10.0), "then over to home"
    down = one.demand((1.2, 1.0, 10.0))
    assert down.p_enu_m == (1.0, 1.0, None)
    assert down.v_enu_m_s[2] < 0
    assert one.demand((3.0, 1.0, 5.0)).v_enu_m_s[2] < 0, "what drifts off while it lands lands all the same"


def test_a_fence_of_nothing_holds_nobody() -> None:
    far = (100.0, 0.0, 100.0)
    assert not is_outside_fence(far, _HOME, _with())
    assert is_outside_fence(far, _HOME, _with(GF_MAX_HOR_DIST=50.0))
    assert is_outside_fence((1.0, 1.0, 11.0), _HOME, _with(GF_MAX_VER_DIST=10.0))
    assert not is_outside_fence((40.0, 1.0, 9.0), _HOME, _with(GF_MAX_HOR_DIST=50.0, GF_MAX_VER_DIST=10.0))
