"""Datagrams of the true state, known to the simulator only: mock autopilot -> world -> demo (msgpack, Unix sockets)."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec

from companion.core.messages import Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleTruth:
    """The true state of the flying vehicle and what its autopilot received, sent by the mock autopilot at 100 Hz."""

    t_mono_ns: int
    p_enu_m: Vector3
    """In the world frame: East, North, Up from the vehicle's start on the ground."""
    v_enu_m_s: Vector3
    yaw_enu_rad: float
    mode: str
    armed: bool
    setpoints: int
    """SET_POSITION_TARGET_LOCAL_NED received since the start."""
    setpoints_in_offboard: int
    offboard_s: float
    """Time spent in OFFBOARD so far."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldTruth:
    """The true state of everything, sent by the world to the demo at 20 Hz."""

    t_mono_ns: int
    vehicle: VehicleTruth
    uav_antenna_enu_m: Vector3
    beacon_antenna_enu_m: Vector3
    beacon_v_enu_m_s: Vector3
    distance_m: float
    """Between the two antennas."""
    exchanges: int
    """Forward/reverse exchanges made so far."""


def encode(truth: VehicleTruth | WorldTruth) -> bytes:
    return msgspec.msgpack.encode(truth)


def decode_vehicle(datagram: bytes) -> VehicleTruth:
    return msgspec.msgpack.decode(datagram, type=VehicleTruth)


def decode_world(datagram: bytes) -> WorldTruth:
    return msgspec.msgpack.decode(datagram, type=WorldTruth)
