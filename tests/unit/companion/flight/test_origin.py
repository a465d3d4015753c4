"""An origin is given on the ground, to a vehicle without GPS that has none and takes our poses; and to no other."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from companion.autopilot.port import AutopilotError
from companion.config.schema import AutopilotConfig
from companion.core.clock import NS_PER_S
from companion.core.messages import VehicleState
from companion.flight.origin import Origin

_NOW_NS = 100 * NS_PER_S
_DENIED = AutopilotConfig("udpin://127.0.0.1:14540", gps=False, forward_vio_hz=50.0, origin_deg=(51.5, -0.1))
_STANDS = VehicleState(t_mono_ns=_NOW_NS, estimator_mono_ns=_NOW_NS, estimator_healthy=True, position_is_global=False)


class _Autopilot:
    def __init__(self, refuses: bool = False) -> None:
        self.origins: list[tuple[float, float]] = []
        self._refuses = refuses

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> None:
        self.origins.append((latitude_deg, longitude_deg))
        if self._refuses:
            raise AutopilotError("the link is closed")


def _told(config: AutopilotConfig, vehicle: VehicleState, seconds: float = 0.0) -> list[tuple[float, float]]:
    autopilot = _Autopilot()
    origin = Origin(autopilot, config)  # type: ignore[arg-type]
    for tick in range(round(20 * seconds) + 1):
        now_ns = _NOW_NS + tick * NS_PER_S // 20
        origin.tick(replace(vehicle, estimator_mono_ns=(vehicle.estimator_mono_ns or 0) + now_ns - _NOW_NS), now_ns)
    return autopilot.origins


def test_it_is_given_and_given_again_until_it_shows() -> None:
    assert _told(_DENIED, _STANDS) == [(51.5, -0.1)]
    assert len(_told(_DENIED, _STANDS, seconds=5.0)) == 3


@pytest.mark.parametrize(
    "change",
    [
        {"position_is_global": True},
        {"position_is_global": None},
        {"estimator_healthy": False},
        {"estimator_mono_ns": _NOW_NS - 3 * NS_PER_S},
        {"armed": True},
        {"in_air": True},
    ],
)
def test_it_is_not_given(change: dict[str, Any]) -> None:
    assert _told(_DENIED, replace(_STANDS, **change)) == []


def test_a_vehicle_with_gps_or_without_our_poses_is_told_nothing() -> None:
    assert _told(replace(_DENIED, gps=True), _STANDS) == _told(replace(_DENIED, forward_vio_hz=0.0), _STANDS) == []


def test_a_closed_link_ends_nothing() -> None:
    autopilot = _Autopilot(refuses=True)
    Origin(autopilot, _DENIED).tick(_STANDS, _NOW_NS)  # type: ignore[arg-type]
    assert len(autopilot.origins) == 1
