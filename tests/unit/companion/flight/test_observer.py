"""Observe mode: what it would send, and that it is judged and written down."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import pytest

from companion.config.schema import GateConfig, MissionConfig
from companion.core.messages import FlightMode, VehicleState
from companion.flight.local_frame import LocalFrame
from companion.flight.observer import Observer, would_be_setpoint
from companion.guidance.target import Target, WholeBelief
from companion.guidance.targets import Targets
from companion.safety.gate import Gate, GateLimits, Reason
from tests.kept import Kept

_MISSION = MissionConfig(speed_m_s=0.4, takeoff_height_m=1.5)
_NORTH = Target(
    t_mono_ns=0,
    azimuth_rad=math.pi / 2,
    origin_local_enu_m=(0.0, 9.0, 0.0),
    covariance_m2=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    boot=1,
    range_m=9.0,
    range_std_m=1.0,
    probability=0.9,
    whole=WholeBelief(
        origin_local_enu_m=(0.0, 9.0, 0.0),
        covariance_m2=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        range_90_m=(7.4, 10.6),
        direction_90_rad=0.2,
    ),
)
_CARRIED = VehicleState(
    t_mono_ns=5, mode=FlightMode.MANUAL, position_mono_ns=5, p_local_enu_m=(1.0, 2.0, 1.4),
    v_local_enu_m_s=(0.0, 0.0, 0.0), yaw_enu_rad=0.0,
)  # fmt: skip


class _Known(Targets):
    """Knows of one target, or of none."""

    def __init__(self, target: Target | None) -> None:
        limits = GateLimits(**asdict(GateConfig()))
        super().__init__(neighbours={}, target=2, arrival_range_m=1.0, arrival_confidence=0.9, limits=limits)
        self.known = target

    @property
    def target(self) -> Target | None:
        return self.known


def _noted(target: Target | None, vehicle: VehicleState) -> Kept:
    kept = Kept()
    gate = Gate(GateLimits(**asdict(GateConfig())))
    Observer(mission=_MISSION, gate=gate, targets=_Known(target), frame=LocalFrame(), recorder=kept).note(vehicle, 5)
    return kept


def test_what_would_be_sent_leads_to_the_target_at_flying_height() -> None:
    wanted = would_be_setpoint(5, (1.0, 2.0, 0.3), math.pi / 2, MissionConfig(speed_m_s=0.4), height_m=1.5)
    assert wanted.p_local_enu_m == pytest.approx((1.0, 2.2, 1.5)) and wanted.v_local_enu_m_s == pytest.approx(
        (0, 0.4, 0)
    )


def test_it_is_written_down_with_what_the_gate_says_to_it() -> None:
    for z_m, reasons in ((1.4, ()), (9.0, (Reason.LEAD,))):
        p_m = (1.0, 2.0, z_m)
        kept = _noted(_NORTH, replace(_CARRIED, p_local_enu_m=p_m))
        ((_, t_ns, message),) = kept.messages
        assert kept.topics == ["/observed_setpoint"] and t_ns == 5
        assert message.setpoint == would_be_setpoint(5, p_m, math.pi / 2, _MISSION, height_m=1.5)
        assert message.reasons == reasons


def test_nothing_is_where_no_target_or_no_place_is_known() -> None:
    assert _noted(None, _CARRIED).messages == []
    assert _noted(_NORTH, VehicleState(t_mono_ns=5)).messages == []
