"""Both ends of a signed link for tests: a vehicle by pymavlink, and what a stranger sends in its name."""

from __future__ import annotations

import secrets
import time
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.signing.relay import now_units


class Vehicle:
    """Signs with a key, or with none."""

    def __init__(self, key: bytes | None, system_id: int = 1, timestamp: int | None = None) -> None:
        self.mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self.mav.robust_parsing = True
        if key is not None:
            self.mav.signing.secret_key = key
            self.mav.signing.sign_outgoing = True
            self.mav.signing.timestamp = now_units() if timestamp is None else timestamp

    def frame(self, number: int = 0) -> bytes:
        """An ATTITUDE with a number in its time."""
        message = self.mav.attitude_encode(number, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0)
        frame = bytes(message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return frame

    def heartbeat(self) -> bytes:
        frame = bytes(self.mav.heartbeat_encode(2, mavlink.MAV_AUTOPILOT_PX4, 81, 0, 3).pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return frame

    def read(self, data: bytes) -> list[Any]:
        """What it takes of what came, by its own check of the signature."""
        return [one for one in self.mav.parse_buffer(data) or () if one.get_type() != "BAD_DATA"]


def key_file(path: Path, key: bytes | None = None) -> bytes:
    path.write_bytes(key or secrets.token_bytes(32))
    path.chmod(0o600)
    return path.read_bytes()


def setpoint(number: int) -> bytes:
    """A set point as MAVSDK sends it: not signed, with a number in its time."""
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    message = mav.set_position_target_local_ned_encode(
        number, 1, 1, mavlink.MAV_FRAME_LOCAL_NED, 0, 1.0, 2.0, -3.0, 0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.5, 0.0
    )
    return bytes(message.pack(mav))


def wait_until(is_so: Any, timeout_s: float = 10.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not is_so():
        assert time.monotonic() < deadline_s
        time.sleep(0.005)
