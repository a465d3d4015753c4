"""Where PX4 ends its takeoff, and who else may have ended it."""

from __future__ import annotations

import pytest

from companion.autopilot.climb import Climb
from companion.autopilot.port import GaveWayError
from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode, VehicleState


def _state(mode: FlightMode, up_m: float, climb_m_s: float, t_s: float = 0.0, in_air: bool = True) -> VehicleState:
    return VehicleState(
        t_mono_ns=round(t_s * NS_PER_S), mode=mode, in_air=in_air, p_local_enu_m=(0.0, 0.0, up_m),
        v_local_enu_m_s=(0.0, 0.0, climb_m_s),
    )  # fmt: skip


@pytest.mark.parametrize("ground_m", [0.0, -0.5])
def test_px4s_own_hold_below_the_height_is_waited_out(ground_m: float) -> None:
    climb = Climb(ground_m, 1.5, 0.8)
    assert not climb.hovers(_state(FlightMode.TAKEOFF, ground_m + 0.6, 1.2))
    assert not climb.hovers(_state(FlightMode.HOLD, ground_m + 0.72, 0.1, 1.0)), "slow for a moment"
    assert not climb.hovers(_state(FlightMode.HOLD, ground_m + 1.1, 0.6, 1.9))
    assert not climb.hovers(_state(FlightMode.HOLD, ground_m + 1.4, 0.05, 3.0))
    assert climb.hovers(_state(FlightMode.HOLD, ground_m + 1.5, 0.0, 4.0))


@pytest.mark.parametrize(
    "states",
    [
        [_state(FlightMode.MANUAL, 0.5, 1.0)],
        [_state(FlightMode.HOLD, 0.3, 1.0)],
        [_state(FlightMode.HOLD, 0.9, 0.0, 1.0), _state(FlightMode.HOLD, 0.9, 0.0, 2.1)],
        [_state(FlightMode.TAKEOFF, 0.9, 1.0), _state(FlightMode.LAND, 0.9, 0.0)],
    ],
)
def test_what_somebody_else_decides_is_given_way_to(states: list[VehicleState]) -> None:
    climb = Climb(0.0, 1.5, 0.8)
    with pytest.raises(GaveWayError):
        for state in states:
            climb.hovers(state)


def test_hold_on_the_ground_is_no_hover() -> None:
    assert not Climb(0.0, 1.5, 0.8).hovers(_state(FlightMode.HOLD, 0.0, 0.0, in_air=False))
