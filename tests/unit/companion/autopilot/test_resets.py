"""Resets of the estimate that PX4 announces."""

from __future__ import annotations

import pytest

from companion.autopilot.resets import PositionResets
from companion.core.messages import Pose, Vector3

_V = (2.0, -4.0, 0.5)
_STEP_NS = 20_000_000


def _pose(t_s: float, p_m: Vector3) -> Pose:
    return Pose(
        t_mono_ns=round(t_s * 1e9), p_enu_m=p_m, q_enu_from_body=(1.0, 0.0, 0.0, 0.0), v_enu_m_s=_V, confidence=3
    )


def _moved(t_s: float, by_m: Vector3 = (0.0, 0.0, 0.0)) -> Pose:
    """Where the motion leads by then, and a step beside it."""
    x, y, z = (v * t_s + step for v, step in zip(_V, by_m, strict=True))
    return _pose(t_s, (x, y, z))


def test_what_motion_does_not_explain_is_the_resets() -> None:
    resets = PositionResets()
    assert not resets.take(_moved(1.0), 4) and not resets.take(_moved(1.5, (0.0, 0.0, 9.0)), 4), "nothing was announced"
    assert not resets.take(_moved(2.0), 4)
    assert resets.take(_moved(2.5, (1.0, -2.0, 3.0)), 5)
    assert resets.count == 1 and resets.offset_enu_m == pytest.approx((1.0, -2.0, 3.0))
    assert not resets.take(_moved(3.0, (1.0, -2.0, 3.0)), 5)
    assert resets.take(_moved(4.0, (2.0, -2.0, 3.0)), 7), "two at once"
    assert resets.count == 3 and resets.offset_enu_m == pytest.approx((2.0, -2.0, 3.0))


@pytest.mark.parametrize(("step_m", "kept"), [(0.09, False), (0.1, False), (0.11, True), (-0.5, True)])
def test_a_step_within_the_noise_is_of_something_else(step_m: float, kept: bool) -> None:
    resets = PositionResets()
    still = Pose(
        t_mono_ns=0,
        p_enu_m=(0.0, 0.0, 0.0),
        q_enu_from_body=(1.0, 0.0, 0.0, 0.0),
        v_enu_m_s=(0.0, 0.0, 0.0),
        confidence=3,
    )
    resets.take(still, 0)
    assert resets.take(
        Pose(
            t_mono_ns=_STEP_NS,
            p_enu_m=(step_m, 0.0, 0.0),
            q_enu_from_body=still.q_enu_from_body,
            v_enu_m_s=still.v_enu_m_s,
            confidence=3,
        ),
        1,
    )
    assert resets.count == 1 and resets.offset_enu_m == ((step_m, 0.0, 0.0) if kept else (0.0, 0.0, 0.0))


def test_the_counter_is_one_byte_and_a_new_boot_has_its_own() -> None:
    resets = PositionResets()
    resets.take(_moved(1.0), 255)
    assert resets.take(_moved(1.1), 0) and resets.count == 1
    assert resets.take(_moved(1.2), 255) and resets.count == 256, "it only rises"
    resets.forget()
    assert not resets.take(_moved(1.3, (5.0, 0.0, 0.0)), 3) and resets.offset_enu_m == (0.0, 0.0, 0.0)
