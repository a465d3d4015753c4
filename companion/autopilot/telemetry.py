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
from collections import Counter, deque
from collections.abc import Callable
from typing import Any, Final

import msgspec

from companion.autopilot.arming_checks import ArmingChecks
from companion.autopilot.batteries import Batteries
from companion.autopilot.kind import drives, kind_of
from companion.autopilot.odometry import pose_from_odometry
from companion.autopilot.px4_modes import flight_mode, left_offboard
from companion.autopilot.resets import PositionResets
from companion.autopilot.vehicle_clock import Turn, VehicleClock
from companion.core.messages import AutopilotEvent, GpsFix, Pose, Vector3, VehicleState
from wsr.frames import enu_of_ned, yaw_enu_from_ned

Fields = dict[str, Any]

_AUTOPILOT_COMPONENT = 1
_MODE_FLAG_SAFETY_ARMED = 128
_STATE_CRITICAL = 5
"""MAV_STATE_CRITICAL: PX4 sets it while a failsafe flies. Those above it are emergency, power off and termination."""
_LANDED_STATES = (1, 2, 3, 4)
_LANDED_STATES_IN_AIR = (2, 3, 4)
"""In air, taking off, landing."""
_PARAMETER_REAL32 = 9
_FIX_3D = 3
"""GPS_FIX_TYPE."""
_EVENTS_KEPT = 100
_WARNING = 4
_ESTIMATED = 1 | 2 | 4
"""ESTIMATOR_STATUS_FLAGS: attitude, horizontal and vertical velocity; all of them are needed,"""
_POSITION_ESTIMATED = 8 | 16
"""relative or absolute horizontal position; one of them is needed,"""
_GLOBAL_POSITION = 16
"""Absolute horizontal position: without GPS PX4 has it once it was given an origin."""
_AIDED = 256 | 512
"""and something that measures it now (PX4 uses its two predictions for that); one of them is needed,"""
_ACCELEROMETER_ERROR = 2048
"""which must not be,"""
_CONSTANT_POSITION = 128
"""nor this in the air. On the ground it is normal: PX4 sets it while the vehicle stands still, disarmed."""
_DECODER: Final = msgspec.json.Decoder()
_OF_EVERY_BOOT: Final = ("heartbeat_mono_ns", "system_id", "autopilot", "offboard_left")
_LANDED_OLD_NS: Final = 3_000_000_000
"""EXTENDED_SYS_STATE is asked for at 5 Hz: who has told it no later than this has not told it."""
_YAW_OLD_NS: Final = 500_000_000
"""ATTITUDE at 20 Hz. A position without a heading of its time can neither be held nor tell where North is."""


class Telemetry:
    """Thread-safe. `parameters` and `acknowledgements` hold the newest value per name and per command.

    On the thread of `take`, `on_odometry` gets the autopilot's own odometry, and `on_time_question` the ts1 of each of
    its TIMESYNC requests.
    """

    def __init__(
        self,
        now_ns: Callable[[], int],
        on_odometry: Callable[[Pose], None] | None = None,
        on_time_question: Callable[[int], None] = lambda _: None,
        wants_gps: bool = False,
    ) -> None:
        self.parameters: dict[str, int | float | None] = {}
        self.acknowledgements: dict[int, int] = {}
        self.acknowledged: Counter[int] = Counter()
        """How often each command was answered."""
        self.malformed = 0
        self._vehicle_clock = VehicleClock()
        self._batteries = Batteries()
        self._arming = ArmingChecks()
        self._resets = PositionResets()
        self._events: deque[AutopilotEvent] = deque(maxlen=_EVENTS_KEPT)  # full: the oldest goes
        self._on_odometry = on_odometry
        self._on_time_question = on_time_question
        self._now_ns = now_ns
        self._lock = threading.Lock()
        self._known: Fields = {"landed_unknown": True}
        """Fields of `VehicleState` by name, as last told."""
        self._told_ns: dict[str, int] = {}
        """When those were told that grow old without a field of `VehicleState` that says so."""
        handlers: dict[str, Callable[[Fields, int], Fields]] = {
            "HEARTBEAT": _heartbeat,
            "CURRENT_MODE": _current_mode,
            "LOCAL_POSITION_NED": self._local_position,
            "ATTITUDE": self._attitude,
            "EXTENDED_SYS_STATE": self._landed_state,
            "BATTERY_STATUS": self._battery,
            "SYS_STATUS": self._status,
            "PARAM_VALUE": self._parameter,
            "COMMAND_ACK": self._acknowledgement,
            "ESTIMATOR_STATUS": self._estimator,
            "RC_CHANNELS": _rc,
            "TIMESYNC": self._timesync,
            "AUTOPILOT_VERSION": _version,
            "ODOMETRY": self._odometry,
            "STATUSTEXT": self._text,
            "EVENT": self._event,
        }
        if wants_gps:
            handlers["GPS_RAW_INT"] = _gps
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
            known = self._handlers[name](_fields(fields_json), now_ns)
        except (ArithmeticError, LookupError, TypeError, ValueError, AttributeError, struct.error):
            self.malformed += 1
            return
        with self._lock:
            self._known.update(known | left_offboard(self._known, known))

    def state(self) -> VehicleState:
        """The newest telemetry, stamped now."""
        with self._lock:
            now_ns, clock = self._now_ns(), self._vehicle_clock
            charge = self._batteries.now(now_ns)
            can_arm = self._arming.passed(self._known.get("firmware", ""), now_ns)
            return VehicleState(
                **(self._known | self._outdated(now_ns)),
                t_mono_ns=now_ns,
                battery_remaining=charge.remaining,
                battery_mono_ns=charge.mono_ns,
                batteries_unknown=charge.unknown,
                can_arm=can_arm,
                arming_reasons=() if can_arm is not False else self._arming.reasons(self._known.get("mode"), now_ns),
                are_two=clock.is_of_two(now_ns),
                clock_offset_ns=clock.offset_ns,
                stood_still_ns=clock.stood_still_ns,
                resets=self._resets.count,
                p_reset_enu_m=self._resets.offset_enu_m,
            )

    def fails_silently(self) -> bool:
        """It cannot arm, and has not told why."""
        with self._lock:
            now_ns, known = self._now_ns(), self._known
            can_arm = known.get("armed") or self._arming.passed(known.get("firmware", ""), now_ns)
            return can_arm is False and not self._arming.reasons(known.get("mode"), now_ns)

    def _outdated(self, now_ns: int) -> Fields:
        """What has been told too long ago to be so still: a message may stop while heartbeats go on."""
        landed_ns, yaw_ns = self._told_ns.get("landed"), self._told_ns.get("yaw")
        old: Fields = {}
        if landed_ns is not None and now_ns - landed_ns > _LANDED_OLD_NS:
            old["landed_unknown"] = True
        if yaw_ns is not None and now_ns - yaw_ns > _YAW_OLD_NS:
            old["yaw_enu_rad"] = None
        return old

    def identify(self, system_id: int) -> None:
        """Which vehicle this is the telemetry of."""
        with self._lock:
            self._known["system_id"] = system_id

    def told(self, field: str) -> Any:
        """One field of `VehicleState`, as last told; None before."""
        with self._lock:
            return self._known.get(field)

    def vehicle_ns(self, t_mono_ns: int) -> int | None:
        """The vehicle's own time at one of ours; None while it is not known."""
        with self._lock:
            return self._vehicle_clock.at(t_mono_ns)

    def take_events(self) -> list[AutopilotEvent]:
        """What the autopilot has said since the last call, oldest first."""
        return [self._events.popleft() for _ in range(len(self._events))]

    def _told(self, vehicle_ns: int, now_ns: int) -> None:
        """What a message says of the vehicle's clock: it may have restarted, or ours may have stood still."""
        with self._lock:
            was_of_two = self._vehicle_clock.is_of_two(now_ns)
            turn = self._vehicle_clock.told(vehicle_ns, now_ns)
            is_of_two = self._vehicle_clock.is_of_two(now_ns)
            if turn is Turn.RESTARTED:
                self._forget()
        if is_of_two and not was_of_two:
            text = "two vehicles of one system id: their clocks alternate"
            self._events.append(AutopilotEvent(now_ns, _WARNING, text))
        elif turn is Turn.RESTARTED and not is_of_two:
            text = f"the autopilot has restarted: its clock is at {vehicle_ns / 1e9:.1f} s again"
            self._events.append(AutopilotEvent(now_ns, _WARNING, text))
        elif turn is Turn.LEAPT:
            text = f"our clock stood still: the autopilot's went on by {self._vehicle_clock.stood_still_ns / 1e9:.1f} s"
            self._events.append(AutopilotEvent(now_ns, _WARNING, text))

    def _forget(self) -> None:
        """All that was of the boot before, but for who it is and that it is heard."""
        was, self._known = self._known, {"boots": self._known.get("boots", 0) + 1, "landed_unknown": True}
        self._known.update((name, was[name]) for name in _OF_EVERY_BOOT if name in was)
        self._batteries = Batteries()
        self._arming = ArmingChecks()
        self._resets.forget()
        self.parameters.clear()
        self.acknowledgements.clear()

    def _text(self, fields: Fields, now_ns: int) -> Fields:
        text, severity = str(fields["text"]).rstrip("\0"), int(fields["severity"])
        self._events.append(AutopilotEvent(now_ns, severity, text))
        with self._lock:
            self._arming.text(severity, text)
        return {}

    def _event(self, fields: Fields, now_ns: int) -> Fields:
        # The low half of log_levels is for the pilot (PX4 events interface); the text lies in the autopilot's metadata.
        severity = int(fields["log_levels"]) & 0x0F
        number, arguments = int(fields["id"]), bytes(fields.get("arguments", ()))
        self._events.append(AutopilotEvent(now_ns, severity, f"event {number}"))
        with self._lock:
            self._arming.event(number, severity, int.from_bytes(arguments[:4], "little"))
        return {}

    def _odometry(self, fields: Fields, now_ns: int) -> Fields:
        pose = pose_from_odometry(fields, now_ns)
        vehicle_ns = int(fields["time_usec"]) * 1000
        with self._lock:
            self._resets.take(dataclasses.replace(pose, t_mono_ns=vehicle_ns), int(fields["reset_counter"]))
        if self._on_odometry is not None:
            self._on_odometry(pose)
        return {}

    def _local_position(self, fields: Fields, now_ns: int) -> Fields:
        position = _enu(fields["x"], fields["y"], fields["z"])
        velocity = _enu(fields["vx"], fields["vy"], fields["vz"])
        self._told(self._boot_ns(fields, now_ns), now_ns)
        return {
            "position_mono_ns": now_ns,
            "p_local_enu_m": position,
            "v_local_enu_m_s": velocity,
            "boot_ms": int(fields["time_boot_ms"]),
        }

    def _attitude(self, fields: Fields, now_ns: int) -> Fields:
        yaw_rad = yaw_enu_from_ned(_finite(fields["yaw"]))
        self._told(self._boot_ns(fields, now_ns), now_ns)
        self._told_ns["yaw"] = now_ns
        return {"yaw_enu_rad": yaw_rad, "boot_ms": int(fields["time_boot_ms"])}

    def _boot_ns(self, fields: Fields, now_ns: int) -> int:
        with self._lock:
            return self._vehicle_clock.unwrapped(int(fields["time_boot_ms"]), now_ns) * 1_000_000

    def _landed_state(self, fields: Fields, now_ns: int) -> Fields:
        told = int(fields["landed_state"])
        self._told_ns["landed"] = now_ns
        return {"in_air": told in _LANDED_STATES_IN_AIR, "landed_unknown": told not in _LANDED_STATES}

    def _timesync(self, fields: Fields, now_ns: int) -> Fields:
        """Without tc1 PX4 asks for our time, and ts1 is its own."""
        if int(fields["tc1"]):
            return {}
        ts1 = int(fields["ts1"])
        self._told(ts1, now_ns)
        self._on_time_question(ts1)
        return {"timesync_mono_ns": now_ns}

    def _battery(self, fields: Fields, now_ns: int) -> Fields:
        percent = int(fields["battery_remaining"])
        with self._lock:
            self._batteries.take(int(fields["id"]), percent / 100 if 0 <= percent <= 100 else None, now_ns)
        return {}

    def _status(self, fields: Fields, now_ns: int) -> Fields:
        present, enabled, health = (
            int(fields[f"onboard_control_sensors_{part}"]) for part in ("present", "enabled", "health")
        )
        with self._lock:
            self._arming.status(present, enabled, health, now_ns)
        return {}

    @property
    def _drives(self) -> bool:
        """A rover that is armed and stands is in the air by PX4's word, and at rest by its estimator's."""
        return drives(str(self._known.get("autopilot", "")))

    def _estimator(self, fields: Fields, now_ns: int) -> Fields:
        flags = int(fields["flags"])
        return {
            "estimator_mono_ns": now_ns,
            "estimator_healthy": is_healthy(flags, self._known.get("in_air", False) and not self._drives),
            "position_is_global": bool(flags & _GLOBAL_POSITION),
        }

    def _parameter(self, fields: Fields, now_ns: int) -> Fields:
        value = fields["param_value"]
        if fields["param_type"] != _PARAMETER_REAL32 and value is not None:
            # PX4 puts an integer's four bytes where the float would be.
            (value,) = struct.unpack("<i", struct.pack("<f", value))
        self.parameters[str(fields["param_id"]).rstrip("\0")] = value
        return {}

    def _acknowledgement(self, fields: Fields, now_ns: int) -> Fields:
        self.acknowledgements[int(fields["command"])] = int(fields["result"])
        self.acknowledged[int(fields["command"])] += 1
        return {}


def _fields(text: str) -> Fields:
    """In a third of the time that `json` takes; which alone takes NaN and infinity for numbers."""
    try:
        fields: Fields = _DECODER.decode(text)
    except msgspec.DecodeError:
        fields = json.loads(text)
    return fields


def _heartbeat(fields: Fields, now_ns: int) -> Fields:
    return {
        "heartbeat_mono_ns": now_ns,
        "mode": flight_mode(fields["custom_mode"]),
        "mode_mono_ns": now_ns,
        "armed": bool(fields["base_mode"] & _MODE_FLAG_SAFETY_ARMED),
        "failsafe": int(fields["system_status"]) >= _STATE_CRITICAL,
        "autopilot": kind_of(int(fields["autopilot"]), int(fields["type"])),
    }


def _current_mode(fields: Fields, now_ns: int) -> Fields:
    intended = int(fields.get("intended_custom_mode", 0))
    return {
        "mode": flight_mode(fields["custom_mode"]),
        "mode_mono_ns": now_ns,
        "intended_mode": flight_mode(intended) if intended else None,
    }


def is_healthy(flags: int, in_air: bool) -> bool:
    """Whether ESTIMATOR_STATUS.flags tell of a position that can be flown by, with GPS or with our poses."""
    needed = flags & _ESTIMATED == _ESTIMATED and bool(flags & _POSITION_ESTIMATED) and bool(flags & _AIDED)
    return needed and not flags & (_ACCELEROMETER_ERROR | (_CONSTANT_POSITION if in_air else 0))


def _rc(fields: Fields, now_ns: int) -> Fields:
    channels = tuple(int(fields[f"chan{i}_raw"]) for i in range(1, min(18, int(fields["chancount"])) + 1))
    return {"rc_mono_ns": now_ns, "rc_us": channels}


def _gps(fields: Fields, now_ns: int) -> Fields:
    """What is 0 of the extensions is not known: a receiver or a firmware that does not tell it."""
    if int(fields["fix_type"]) < _FIX_3D:
        return {"gps": None}
    hae, horizontal, vertical = (int(fields.get(name, 0)) for name in ("alt_ellipsoid", "h_acc", "v_acc"))
    fix = GpsFix(
        t_mono_ns=now_ns,
        latitude_deg=int(fields["lat"]) * 1e-7,
        longitude_deg=int(fields["lon"]) * 1e-7,
        hae_m=hae * 1e-3 if hae else None,
        horizontal_m=horizontal * 1e-3 if horizontal else None,
        vertical_m=vertical * 1e-3 if vertical else None,
    )
    return {"gps": fix}


def _version(fields: Fields, now_ns: int) -> Fields:
    version = int(fields["flight_sw_version"])
    return {"firmware": ".".join(str(version >> shift & 0xFF) for shift in (24, 16, 8))}


def parameter_field(value: int | float) -> float:
    """PX4 takes the four bytes of an integer where the float would be."""
    if not isinstance(value, int):
        return value
    (field,) = struct.unpack("<f", struct.pack("<i", value))
    return float(field)


def _enu(north: Any, east: Any, down: Any) -> Vector3:
    return enu_of_ned(_finite(north), _finite(east), _finite(down))


def _finite(value: Any) -> float:
    """Raises TypeError for null, which is how the library writes NaN, and ValueError for what is no finite number."""
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{value}: expected a finite number")
    return number
