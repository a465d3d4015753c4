"""One table of all that flows through the service: what it is called in the log, how often, and when it is stale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Stream:
    """`rate_hz` is what a healthy system delivers; `stale_s` after the newest message the stream counts as lost."""

    topic: str
    rate_hz: float
    stale_s: float
    encoding: str
    """Message encoding in the log: "json" (with a JSON schema) or "raw" (bytes as received)."""


CSI: Final = Stream("/csi", 150, 2.0, "raw")
POSE: Final = Stream("/pose", 200, 0.2, "json")
NEIGHBOUR: Final = Stream("/neighbour", 10, 2.0, "raw")
VEHICLE: Final = Stream("/vehicle", 20, 1.5, "json")
SETPOINT: Final = Stream("/setpoint", 20, 0.2, "json")
GATE: Final = Stream("/gate", 0, 0.0, "json")
MISSION: Final = Stream("/mission", 0, 0.0, "json")
BEARING: Final = Stream("/bearing", 0.3, 20.0, "json")
PROFILE: Final = Stream("/aoa_profile", 0.3, 20.0, "raw")
AUTOPILOT_EVENT: Final = Stream("/autopilot_event", 0, 0.0, "json")
OBSERVED: Final = Stream("/observed_setpoint", 0, 0.0, "json")
HEALTH: Final = Stream("/health", 1, 3.0, "json")

STREAMS: Final = (
    CSI,
    POSE,
    NEIGHBOUR,
    VEHICLE,
    SETPOINT,
    GATE,
    MISSION,
    BEARING,
    PROFILE,
    AUTOPILOT_EVENT,
    OBSERVED,
    HEALTH,
)
