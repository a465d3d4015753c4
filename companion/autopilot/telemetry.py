"""The newest telemetry as one `VehicleState`, fed by the MAVLink library's own thread.

Nothing is queued: each message replaces what it knows better, and its arrival time is taken here, so a stalled event
loop finds neither a backlog nor a heartbeat that looks fresh because it was read late.
"""

from __future__ import annotations

import dataclasses
import json
import math
import struct
import threading
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from companion.autopilot.odometry import pose_from_odometry
from companion.autopilot.px4_modes import flight_mode
from companion.core.messages import AutopilotEvent, Pose, Vector3, VehicleState
from wsr.frames import enu_from_ned, yaw_enu_from_ned

Fields = dict[str, Any]

_AUTOPILOT_COMPONENT = 1
_MODE_FLAG_SAFETY_ARMED = 128
_STATE_CRITICAL = 5
"""MAV_STATE_CRITICAL: PX4 sets it while a failsafe flies."""
_LANDED_STATES_IN_AIR = (2, 3, 4)
"""In air, taking off, landing."""
_PARAMETER_REAL32 = 9
_EVENTS_KEPT = 100
_ESTIMATED = 1 | 2 | 4
"""ESTIMATOR_STATUS_FLAGS: attitude, horizontal and vertical velocity; all of them are needed,"""
_POSITION_ESTIMATED = 8 | 16
"""relative or absolute horizontal position; one of them is needed,"""
_NOT_ESTIMATED = 128 | 2048
"""constant position mode, accelerometer error; none of them may be set."""


class Telemetry:
    """Thread-safe. `parameters` and `acknowledgements` hold the newest value per name and per command.

    `on_odometry` gets the autopilot's own odometry, on the thread of `take`.
    """

    def __init__(self, now_ns: Callable[[], int], on_odometry: Callable[[Pose], None] | None = None) -> None:
        self.parameters: dict[str, int | float | None] = {}
        self.acknowledgements: dict[int, int] = {}
        self.malformed = 0
        self._events: deque[AutopilotEvent] = deque(maxlen=_EVENTS_KEPT)  # full: the oldest goes
        self._on_odometry = on_odometry
        self._now_ns = now_ns
        self._lock = threading.Lock()
        self._state = VehicleState(t_mono_ns=now_ns())
        handlers: dict[str, Callable[[Fields, int], Fields]] = {
            "HEARTBEAT": _heartbeat,
            "CURRENT_MODE": _current_mode,
            "LOCAL_POSITION_NED": _local_position,
            "ATTITUDE": _attitude,
            "EXTENDED_SYS_STATE": _landed_state,
            "BATTERY_STATUS": _battery,
            "PARAM_VALUE": self._parameter,
            "COMMAND_ACK": self._acknowledgement,
            "ESTIMATOR_STATUS": _estimator,
            "RC_CHANNELS": _rc,
            "TIMESYNC": _timesync,
            "STATUSTEXT": self._text,
            "EVENT": self._event,
        }
        if on_odometry is not None:
            handlers["ODOMETRY"] = self._odometry
        self._handlers: Final = handlers

    @property
    def message_names(self) -> tuple[str, ...]:
        """What to subscribe to."""
        return tuple(self._handlers)

    def take(self, name: str, component_id: int, fields_json: str) -> None:
        """One message as the library decoded it. Never raises: what does not fit is counted in `malformed`."""
        if component_id != _AUTOPILOT_COMPONENT:
            return  # cameras and gimbals share the autopilot's system id
        now_ns = self._now_ns()
        try:
            known = self._handlers[name](json.loads(fields_json), now_ns)
        except (KeyError, TypeError, ValueError):
            self.malformed += 1
            return
        with self._lock:
            self._state = dataclasses.replace(self._state, **known)

    def state(self) -> VehicleState:
        """The newest telemetry, stamped now."""
        with self._lock:
            return dataclasses.replace(self._state, t_mono_ns=self._now_ns())

    def take_events(self) -> list[AutopilotEvent]:
        """What the autopilot has said since the last call, oldest first."""
        events = []
        while self._events:
            events.append(self._events.popleft())
        return events

    def _text(self, fields: Fields, now_ns: int) -> Fields:
        text = str(fields["text"]).rstrip("\0")
        self._events.append(AutopilotEvent(now_ns, int(fields["severity"]), text))
        return {}

    def _event(self, fields: Fields, now_ns: int) -> Fields:
        # The low half of log_levels is for the pilot (PX4 events interface); the text lies in the autopilot's metadata.
        severity = int(fields["log_levels"]) & 0x0F
        self._events.append(AutopilotEvent(now_ns, severity, f"event {int(fields['id'])}"))
        return {}

    def _odometry(self, fields: Fields, now_ns: int) -> Fields:
        assert self._on_odometry is not None
        self._on_odometry(pose_from_odometry(fields, now_ns))
        return {}

    def _parameter(self, fields: Fields, now_ns: int) -> Fields:
        value = fields["param_value"]
        if fields["param_type"] != _PARAMETER_REAL32 and value is not None:
            # PX4 puts an integer's four bytes where the float would be.
            value = struct.unpack("<i", struct.pack("<f", value))[0]
        self.parameters[str(fields["param_id"]).rstrip("\0")] = value
        return {}

    def _acknowledgement(self, fields: Fields, now_ns: int) -> Fields:
        self.acknowledgements[int(fields["command"])] = int(fields["result"])
        return {}


def _heartbeat(fields: Fields, now_ns: int) -> Fields:
    return {
        "heartbeat_mono_ns": now_ns,
        "mode": flight_mode(fields["custom_mode"]),
        "mode_mono_ns": now_ns,
        "armed": bool(fields["base_mode"] & _MODE_FLAG_SAFETY_ARMED),
        "failsafe": fields["system_status"] == _STATE_CRITICAL,
    }


def _current_mode(fields: Fields, now_ns: int) -> Fields:
    return {"mode": flight_mode(fields["custom_mode"]), "mode_mono_ns": now_ns}


def _local_position(fields: Fields, now_ns: int) -> Fields:
    return {
        "position_mono_ns": now_ns,
        "p_local_enu_m": _enu(fields["x"], fields["y"], fields["z"]),
        "v_local_enu_m_s": _enu(fields["vx"], fields["vy"], fields["vz"]),
    }


def _attitude(fields: Fields, now_ns: int) -> Fields:
    return {"yaw_enu_rad": yaw_enu_from_ned(_finite(fields["yaw"]))}


def _landed_state(fields: Fields, now_ns: int) -> Fields:
    return {"in_air": fields["landed_state"] in _LANDED_STATES_IN_AIR}


def _battery(fields: Fields, now_ns: int) -> Fields:
    percent = int(fields["battery_remaining"])
    return {"battery_remaining": percent / 100 if percent >= 0 else None}


def _estimator(fields: Fields, now_ns: int) -> Fields:
    flags = int(fields["flags"])
    healthy = flags & _ESTIMATED == _ESTIMATED and bool(flags & _POSITION_ESTIMATED) and not flags & _NOT_ESTIMATED
    return {"estimator_mono_ns": now_ns, "estimator_healthy": healthy}


def _rc(fields: Fields, now_ns: int) -> Fields:
    channels = tuple(int(fields[f"chan{i}_raw"]) for i in range(1, min(18, int(fields["chancount"])) + 1))
    return {"rc_mono_ns": now_ns, "rc_us": channels}


def _timesync(fields: Fields, now_ns: int) -> Fields:
    return {"timesync_mono_ns": now_ns}


def parameter_field(value: int | float) -> float:
    """PX4 takes the four bytes of an integer where the float would be."""
    if not isinstance(value, int):
        return value
    (field,) = struct.unpack("<f", struct.pack("<i", value))
    return float(field)


def _enu(*ned: Any) -> Vector3:
    east, north, up = (float(v) for v in enu_from_ned([_finite(v) for v in ned]))
    return (east, north, up)


def _finite(value: Any) -> float:
    """Raises TypeError for null, which is how the library writes NaN, and ValueError for what is no finite number."""
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value}: expected a finite number")
    return number
