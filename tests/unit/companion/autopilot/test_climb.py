"""Where PX4 ends its takeoff, and who else may have ended it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.autopilot.climb import Climb, HeightRead
from companion.autopilot.port import GaveWayError
from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode, VehicleState


def _state(mode: FlightMode, up_m: float, climb_m_s: float, t_s: float = 0.0, in_air: bool = True) -> VehicleState:
    return VehicleState(
        t_mono_ns=round(t_s * NS_PER_S), mode=mode, in_air=in_air, armed=True, p_local_enu_m=(0.0, 0.0, up_m),
        v_local_enu_m_s=(0.0, 0.0, climb_m_s),
    )  # fmt: skip


_DISARMED = replace(_state(FlightMode.HOLD, 0.0, 0.0, in_air=False), armed=False)
"""By a person, before it left the ground: whoever takes off next does so for himself."""


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
        [_state(FlightMode.HOLD, 0.9, 0.0, 1.0), _state(FlightMode.HOLD, 0.9, 0.0, 4.0)],
        [_state(FlightMode.TAKEOFF, 0.9, 1.0), _state(FlightMode.LAND, 0.9, 0.0)],
        [_state(FlightMode.TAKEOFF, 0.0, 0.0, in_air=False), _DISARMED],
    ],
)
def test_what_somebody_else_decides_is_given_way_to(states: list[VehicleState]) -> None:
    climb = Climb(0.0, 1.5, 0.8)
    with pytest.raises(GaveWayError):
        for state in states:
            climb.hovers(state)


def test_px4_that_brakes_into_its_hold_is_no_rest_below() -> None:
    """As PX4 1.16.1 was seen to climb: seconds in hold, and the estimate's Up."""
    seen = [(0.0, 0.73), (0.35, 0.89), (0.6, 0.95), (0.8, 0.99), (1.1, 1.01), (1.4, 1.03), (1.8, 1.11), (2.6, 1.26)]
    climb = Climb(0.0, 1.5, 0.8)
    assert not any(climb.hovers(_state(FlightMode.HOLD, up_m, 0.2, t_s)) for t_s, up_m in seen)
    assert not climb.hovers(_state(FlightMode.HOLD, 1.46, 0.1, 3.6))
    assert climb.hovers(_state(FlightMode.HOLD, 1.44, 0.0, 4.6))


@pytest.mark.parametrize("asked_again_s", [13.0, 13.05, 20.0])
def test_it_stays_below_after_three_seconds_and_no_earlier(asked_again_s: float) -> None:
    """Also when telemetry pauses and nobody asks at that very moment."""
    climb = Climb(0.0, 1.5, 0.8)
    assert not climb.hovers(_state(FlightMode.HOLD, 0.9, 0.0, 10.0))
    assert not climb.hovers(_state(FlightMode.HOLD, 1.04, 0.0, 12.999_999_999))
    with pytest.raises(GaveWayError):
        climb.hovers(_state(FlightMode.HOLD, 1.04, 0.0, asked_again_s))


def test_a_rest_that_began_below_is_a_hover_after_three_seconds_too() -> None:
    climb = Climb(0.0, 1.5, 0.8)
    assert not climb.hovers(_state(FlightMode.HOLD, 1.04, 0.0, 10.0))
    assert not climb.hovers(_state(FlightMode.HOLD, 1.19, 0.0, 12.999_999_999)), "it may still be on its way"
    assert climb.hovers(_state(FlightMode.HOLD, 1.19, 0.0, 13.0))


def test_hold_on_the_ground_is_no_hover() -> None:
    assert not Climb(0.0, 1.5, 0.8).hovers(_state(FlightMode.HOLD, 0.0, 0.0, in_air=False))


def test_it_hovers_after_a_second_of_stillness_and_no_earlier() -> None:
    climb = Climb(0.0, 1.5, 0.8)
    assert not climb.hovers(_state(FlightMode.HOLD, 1.5, 0.0, 100.0))
    assert not climb.hovers(_state(FlightMode.HOLD, 1.64, 0.0, 100.999_999_999)), "0.14 m within a second is still"
    assert climb.hovers(_state(FlightMode.HOLD, 1.36, 0.0, 101.0))
    assert not climb.hovers(_state(FlightMode.HOLD, 1.66, 0.0, 101.5)), "it counts anew, from there"
    assert not climb.hovers(_state(FlightMode.HOLD, 1.5, 0.0, 102.0))
    assert not climb.hovers(_state(FlightMode.HOLD, 1.5, 0.0, 102.499_999_999))
    assert climb.hovers(_state(FlightMode.HOLD, 1.5, 0.0, 103.0))


def test_a_hover_at_the_origins_height_may_move_by_15_cm() -> None:
    climb = Climb(-1.5, 1.5, 0.8)
    assert not climb.hovers(_state(FlightMode.HOLD, 0.0, 0.0, 5.0))
    assert climb.hovers(_state(FlightMode.HOLD, 0.15, 0.0, 6.0))


def test_a_hover_whose_climb_rate_is_all_noise_is_one() -> None:
    climb, found = Climb(0.0, 1.5, 0.8), []
    for step in range(40):
        rate_m_s = 0.3 if step % 2 else -0.3
        found.append(climb.hovers(_state(FlightMode.HOLD, 1.5 + rate_m_s / 10, rate_m_s, step / 20)))
    assert found.index(True) == 20 and all(found[20:])


def test_a_slow_climb_is_no_hover() -> None:
    climb = Climb(0.0, 2.0, 1.0)
    assert not any(climb.hovers(_state(FlightMode.HOLD, 1.0 + 0.2 * t / 20, 0.2, t / 20)) for t in range(80))


@pytest.mark.parametrize(("ground_m", "height_m", "radius_m"), [(0.5, 4.0, 1.25), (-2.0, 20.0, 0.8), (3.0, 6.0, 2.0)])
def test_a_hold_may_begin_as_low_as_px4_ends_its_takeoff(ground_m: float, height_m: float, radius_m: float) -> None:
    ends_m = ground_m + height_m - radius_m - 0.3
    assert not Climb(ground_m, height_m, radius_m).hovers(_state(FlightMode.HOLD, ends_m, 1.0))
    assert not Climb(ground_m, height_m, radius_m).hovers(_state(FlightMode.HOLD, ends_m + 0.01, 1.0))
    with pytest.raises(GaveWayError, match="ended below its height"):
        Climb(ground_m, height_m, radius_m).hovers(_state(FlightMode.HOLD, ends_m - 0.01, 1.0))


def test_where_it_began_to_hold_is_looked_at_once() -> None:
    climb = Climb(0.0, 1.5, 0.1)
    assert not climb.hovers(_state(FlightMode.HOLD, 1.2, 0.5))
    assert not climb.hovers(_state(FlightMode.HOLD, 1.06, -0.5)), "a dip later on is the air's"


def test_to_rest_at_seven_tenths_is_enough() -> None:
    climb = Climb(0.0, 10.0, 5.0)
    assert not climb.hovers(_state(FlightMode.HOLD, 7.0, 0.0, 1.0))
    assert climb.hovers(_state(FlightMode.HOLD, 7.0, 0.0, 2.0))


@pytest.mark.parametrize("known", [("p_local_enu_m",), ("v_local_enu_m_s",), ()])
def test_a_position_that_is_lost_ends_it(known: tuple[str, ...]) -> None:
    names = {"p_local_enu_m", "v_local_enu_m_s"} - set(known)
    state = replace(_state(FlightMode.HOLD, 1.5, 0.0), **dict.fromkeys(names))  # type: ignore[arg-type]
    with pytest.raises(GaveWayError, match="the position was lost"):
        Climb(0.0, 1.5, 0.8).hovers(state)


def test_as_long_as_px4_takes_off_it_is_px4s_own() -> None:
    """However low, and however still."""
    climb = Climb(0.0, 1.5, 0.8)
    for t_s in (0.0, 1.0, 2.0):
        assert not climb.hovers(_state(FlightMode.TAKEOFF, 0.1, 0.0, t_s))


@pytest.mark.parametrize("set_s", [0.0, 0.4, 10.0])
def test_a_height_is_read_after_a_second_and_a_half_and_no_earlier(set_s: float) -> None:
    """And stays read; however young our own clock is."""
    read = HeightRead(_state(FlightMode.HOLD, 0.0, 0.0, set_s, in_air=False))
    for later_s, is_over in ((0.0, False), (1.499_999_999, False), (1.5, True), (1.55, True), (600.0, True)):
        assert read.is_over(_state(FlightMode.HOLD, 0.0, 0.0, set_s + later_s, in_air=False)) is is_over, later_s


@pytest.mark.parametrize("mode", sorted(set(FlightMode) - {FlightMode.HOLD}))
def test_who_chooses_a_mode_while_the_height_is_read_is_given_way_to(mode: FlightMode) -> None:
    before = _state(FlightMode.HOLD, 0.0, 0.0, 10.0, in_air=False)
    for armed in (False, True):
        with pytest.raises(GaveWayError, match="meanwhile; somebody else decided"):
            HeightRead(before).is_over(replace(before, mode=mode, armed=armed))


@pytest.mark.parametrize("armed", [False, True])
def test_who_arms_or_disarms_while_the_height_is_read_is_given_way_to(armed: bool) -> None:
    before = replace(_state(FlightMode.HOLD, 0.0, 0.0, 10.0, in_air=False), armed=armed)
    with pytest.raises(GaveWayError, match=f"armed {not armed} meanwhile; somebody else decided"):
        HeightRead(before).is_over(replace(before, armed=not armed))
