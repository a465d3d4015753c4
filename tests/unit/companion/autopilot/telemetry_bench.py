"""Telemetry without a vehicle: messages go in, and the time is what a test says."""

from __future__ import annotations

import json
from typing import Any

from companion.autopilot.telemetry import Telemetry

HEARTBEAT = {"custom_mode": 6 << 16, "base_mode": 129, "system_status": 4, "autopilot": 12, "type": 2}
POSITION: dict[str, Any] = {"x": 1.0, "y": 2.0, "z": -3.0, "vx": 0.1, "vy": 0.2, "vz": -0.3, "time_boot_ms": 57_000}


class TelemetryBench:
    def __init__(self) -> None:
        self.now_ns = 1000
        self.telemetry = Telemetry(lambda: self.now_ns)

    def take(self, name: str, fields: object, component_id: int = 1) -> None:
        self.telemetry.take(name, component_id, json.dumps(fields))
