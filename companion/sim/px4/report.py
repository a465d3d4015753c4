"""What the mock tells a test that asks: one msgpack datagram."""

from __future__ import annotations

from dataclasses import dataclass, field

import msgspec

from companion.core.messages import Vector3


@dataclass(frozen=True, slots=True, kw_only=True)
class Px4Report:
    """The mock's state and its counters. Times are CLOCK_MONOTONIC, shared by all processes of the host."""

    t_mono_ns: int
    mode: str
    armed: bool
    landed: bool
    failsafe: bool
    p_enu_m: Vector3
    v_enu_m_s: Vector3
    yaw_enu_rad: float
    setpoints: int
    setpoints_in_offboard: int
    setpoints_outside: int
    last_setpoint_mono_ns: int | None
    largest_gap_s: float
    """Between two set points within one stay in OFFBOARD."""
    offboard_s: float
    peer_heartbeats: int
    timesync_answers: int
    history: list[tuple[int, str]]
    """When each mode began; the newest 200."""
    onboard_statuses: int = 0
    refused: int = 0
    """Frames without the signature it demands."""
    vision: int = 0
    """ODOMETRY messages taken."""
    vision_age_s: float | None = None
    """Of the newest one when it arrived, by the clock with which the companion answers TIMESYNC."""
    vision_p_enu_m: Vector3 | None = None
    vision_reset_counter: int | None = None
    vision_fused: int = 0
    """Of those that were taken, what the estimator did not drop for their time or its parameters."""
    vision_dropped: int = 0
    has_global_position: bool = False
    resets: int = 0
    """PX4's reset_counter."""
    estimated_p_enu_m: Vector3 = (0.0, 0.0, 0.0)
    clock_s: float = 0.0
    """The vehicle's own."""
    strangers: list[Px4Report] = field(default_factory=list)
    received: dict[str, int] = field(default_factory=dict)
    """How much came of each message, and of each command under its number, as in "COMMAND_LONG 511"."""
    parameters: dict[str, float] = field(default_factory=dict)
    error: str | None = None
    """Why the order was not understood; None when it was."""


def encode(report: Px4Report) -> bytes:
    return msgspec.msgpack.encode(report)
