"""Observe mode: what it would send."""

from __future__ import annotations

import math

import pytest

from companion.config.schema import MissionConfig
from companion.flight.observer import would_be_setpoint


def test_what_would_be_sent_leads_to_the_target_at_flying_height() -> None:
    wanted = would_be_setpoint(5, (1.0, 2.0, 0.3), math.pi / 2, MissionConfig(speed_m_s=0.4), 1.5)
    assert wanted.p_local_enu_m == pytest.approx((1.0, 2.2, 1.5)) and wanted.v_local_enu_m_s == pytest.approx(
        (0, 0.4, 0)
    )
