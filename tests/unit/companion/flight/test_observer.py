"""Observe mode: where it cuts the path, and what it would send."""

from __future__ import annotations

import math

import pytest

from companion.config.schema import ApertureConfig, MissionConfig
from companion.core.clock import NS_PER_S
from companion.flight.observer import Observer, would_be_setpoint


class _Sar:
    def __init__(self) -> None:
        self.is_measuring = False
        self.is_waiting = False
        self.path_m = 0.0
        self.finished: list[int] = []

    def begin(self) -> None:
        self.is_measuring, self.path_m = True, 0.0

    def finish(self, end_ns: int) -> None:
        self.is_measuring = False
        self.finished.append(end_ns)

    def path_length_m(self) -> float:
        return self.path_m


def test_the_observer_cuts_the_path_of_whoever_moves_the_vehicle() -> None:
    sar = _Sar()
    observer = Observer(sar, ApertureConfig(length_m=1.2, settle_s=0.3))  # type: ignore[arg-type]
    for tick in range(200):  # 0.5 m/s for 10 s: 4 iterations of 1.2 m
        sar.path_m += 0.025
        observer.tick(tick * NS_PER_S // 20)
    assert len(sar.finished) == 3
    sar.finished.clear()
    sar.path_m = -100.0
    for tick in range(200, 650):  # at rest: one every 20 s
        observer.tick(tick * NS_PER_S // 20)
    assert 1 <= len(sar.finished) <= 2


def test_what_would_be_sent_leads_to_the_target_at_flying_height() -> None:
    wanted = would_be_setpoint(5, (1.0, 2.0, 0.3), math.pi / 2, MissionConfig(speed_m_s=0.4), 1.5)
    assert wanted.p_local_enu_m == pytest.approx((1.0, 2.2, 1.5)) and wanted.v_local_enu_m_s == pytest.approx(
        (0, 0.4, 0)
    )
