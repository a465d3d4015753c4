"""The height it stood at, and places that move along when the vehicle sets its position anew."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.core.clock import NS_PER_S
from companion.core.messages import VehicleState
from companion.flight.local_frame import LocalFrame

_STANDS = VehicleState(t_mono_ns=0, position_mono_ns=0, p_local_enu_m=(0.0, 0.0, -0.4), v_local_enu_m_s=(0.0, 0.0, 0.0))
_FLIES = replace(_STANDS, armed=True, in_air=True, p_local_enu_m=(0.0, 0.0, 1.1))


def _at(state: VehicleState, tick: int) -> tuple[VehicleState, int]:
    now_ns = tick * NS_PER_S // 20
    return replace(state, t_mono_ns=now_ns, position_mono_ns=now_ns), now_ns


def test_the_ground_is_where_it_stood_disarmed() -> None:
    frame = LocalFrame()
    assert frame.follow(*_at(_STANDS, 0)) is None and frame.ground_m == -0.4
    frame.follow(*_at(replace(_STANDS, armed=True, p_local_enu_m=(0.0, 0.0, 0.0)), 1))
    frame.follow(*_at(_FLIES, 2))
    assert frame.ground_m == -0.4


def test_a_vehicle_that_was_never_seen_on_the_ground_has_none() -> None:
    frame = LocalFrame()
    frame.follow(*_at(_FLIES, 0))
    assert frame.ground_m == 0.0


def test_what_is_announced_moves_the_ground_and_is_told_once() -> None:
    frame = LocalFrame()
    frame.follow(*_at(_STANDS, 0))
    frame.follow(*_at(_FLIES, 1))
    moved = replace(_FLIES, p_local_enu_m=(5.0, 0.0, 1.6), p_reset_enu_m=(5.0, 0.0, 0.5))
    assert frame.follow(*_at(moved, 2)) == pytest.approx((5.0, 0.0, 0.5))
    assert frame.ground_m == pytest.approx(0.1)
    assert not frame.is_stepping(_at(moved, 2)[1]), "it is explained"
    assert frame.follow(*_at(moved, 3)) is None


def test_what_was_announced_before_is_no_step() -> None:
    assert LocalFrame().follow(*_at(replace(_FLIES, p_reset_enu_m=(3.0, 0.0, 0.0)), 0)) is None


def test_a_jump_waits_a_quarter_of_a_second_for_its_announcement() -> None:
    frame = LocalFrame()
    frame.follow(*_at(_FLIES, 0))
    jumped = replace(_FLIES, p_local_enu_m=(5.0, 0.0, 1.1))
    frame.follow(*_at(jumped, 1))
    assert frame.is_stepping(_at(jumped, 1)[1]) and frame.is_stepping(_at(jumped, 5)[1])
    assert not frame.is_stepping(_at(jumped, 6)[1])


def test_flying_fast_is_no_jump() -> None:
    frame = LocalFrame()
    for tick in range(20):
        moving = replace(_FLIES, p_local_enu_m=(0.25 * tick, 0.0, 1.1), v_local_enu_m_s=(5.0, 0.0, 0.0))
        frame.follow(*_at(moving, tick))
        assert not frame.is_stepping(_at(moving, tick)[1])
