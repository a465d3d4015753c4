"""Datagrams of the true state come back as they were sent."""

from __future__ import annotations

import msgspec
import pytest

from companion.sim.truth import WorldTruth, decode_vehicle, decode_world, encode
from tests.vehicle_truth import vehicle_truth

_VEHICLE = vehicle_truth(7, (1.0, 2.0, 3.0))
_WORLD = WorldTruth(
    t_mono_ns=7, vehicle=_VEHICLE, uav_antenna_enu_m=(1.0, 2.0, 3.1), beacon_antenna_enu_m=(15.0, 0.0, 0.2),
    beacon_v_enu_m_s=(0.1, 0.0, 0.0), distance_m=14.3, exchanges=12,
)  # fmt: skip


def test_each_is_told_by_its_own_reader() -> None:
    assert decode_vehicle(encode(_VEHICLE)) == _VEHICLE
    assert decode_world(encode(_WORLD)) == _WORLD


@pytest.mark.parametrize("data", [b"", b"\xff" * 30, encode(_WORLD)[:-3]])
def test_anything_else_is_an_error(data: bytes) -> None:
    with pytest.raises(msgspec.DecodeError):
        decode_world(data)
    with pytest.raises(msgspec.DecodeError):
        decode_vehicle(encode(_WORLD))
