"""The mock's MAVLink side: bytes in, bytes out, streams on schedule. No socket, no clock.

NED is written out here by hand instead of taken from `wsr.frames`, so that a slip there cannot cancel itself between
the edge under test and its counterpart.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any, Final, Literal

from pymavlink.dialects.v20 import development as mavlink

from companion.core.messages import Vector3
from companion.sim.px4.airframe import Demand
from companion.sim.px4.commander import NS_PER_S, Commander, Mode, Result, finite_or_none

Mute = Literal["nothing", "heartbeats", "everything"]

_RATES_HZ: Final = {
    "HEARTBEAT": 1.0,
    "SYS_STATUS": 5.0,
    "LOCAL_POSITION_NED": 30.0,
    "ATTITUDE": 50.0,
    "BATTERY_STATUS": 0.5,
    "EXTENDED_SYS_STATE": 5.0,
    "GPS_RAW_INT": 5.0,
    "GLOBAL_POSITION_INT": 10.0,
    "HOME_POSITION": 0.5,
    "CURRENT_MODE": 0.5,
    "TIMESYNC": 10.0,
    "ESTIMATOR_STATUS": 1.0,
    "RC_CHANNELS": 5.0,
    "ODOMETRY": 30.0,
}
"""Streams of PX4's onboard link and their default rates."""
_HOME_LAT_DEG, _HOME_LON_DEG, _HOME_ALT_M = 47.397742, 8.545594, 488.0
_EARTH_RADIUS_M = 6371000.0
_STATUS_PERIOD_NS = NS_PER_S // 2
"""PX4 publishes vehicle_status on change and at 2 Hz; CURRENT_MODE goes out only after such an update."""
_CAPABILITIES = (
    mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
)


class Px4Link:
    """Speaks as system 1, component 1 (the autopilot) to one companion.

    `mute`, `ignore_mode_commands` and `ignore_parameter_requests` are faults to inject.
    """

    def __init__(self, commander: Commander, now_ns: int) -> None:
        self.commander = commander
        self.battery_remaining = 0.95
        self.mute: Mute = "nothing"
        self.ignore_mode_commands = False
        self.ignore_parameter_requests = False
        self.received: dict[str, int] = {}
        """How much came of each message, and of each command under its number."""
        self.peer_heartbeats = 0
        self.timesync_answers = 0
        self._clock_offset_ns: int | None = None
        """Of the companion's clock to ours, as its newest answer told it."""
        self.onboard_statuses = 0
        self.vision: Any = None
        """The newest pose that the companion sent for the estimator."""
        self.visions = 0
        self.vision_age_s: float | None = None
        self.rc_us: list[int] = []
        self.estimator_healthy = True
        self._boot_ns = self._now_ns = now_ns
        self._out: list[bytes] = []
        self._mav = mavlink.MAVLink(self, srcSystem=1, srcComponent=1)
        self._period_ns = {name: round(NS_PER_S / rate) for name, rate in _RATES_HZ.items()}
        self._due_ns = dict.fromkeys(_RATES_HZ, now_ns)
        self._status: tuple[object, ...] = ()
        self._status_ns = now_ns
        self._status_is_new = True
        self._encoders: dict[str, Callable[[], Any]] = {name: getattr(self, f"_{name.lower()}") for name in _RATES_HZ}

    def write(self, frame: bytes) -> None:
        """Called by pymavlink with each packed frame."""
        self._out.append(bytes(frame))

    def receive(self, datagram: bytes, now_ns: int) -> list[bytes]:
        """Handle what arrived; the replies to send at once. Bytes that are no MAVLink are ignored."""
        self._now_ns = now_ns
        parser = mavlink.MAVLink(None)  # a datagram holds whole frames: what is left of one belongs to no other
        parser.robust_parsing = True
        for message in parser.parse_buffer(datagram) or ():
            self._count(message)
            handler = getattr(self, f"_on_{message.get_type().lower()}", None)
            if handler is not None:
                handler(message)
        return self._take()

    def telemetry(self, now_ns: int) -> list[bytes]:
        """The stream messages that are due."""
        self._now_ns = now_ns
        self._watch_status()
        for name, due_ns in self._due_ns.items():
            period_ns = self._period_ns[name]
            if now_ns < due_ns or period_ns <= 0 or (name == "CURRENT_MODE" and not self._status_is_new):
                continue
            self._due_ns[name] = max(due_ns + period_ns, now_ns - period_ns)
            if not self._speaks(name):
                continue
            self._mav.send(self._encoders[name]())
            self._status_is_new &= name != "CURRENT_MODE"
        return self._take()

    def say(self, text: str) -> None:
        """STATUSTEXT of severity warning with the next telemetry."""
        self._mav.send(self._mav.statustext_encode(mavlink.MAV_SEVERITY_WARNING, text.encode()[:50]))

    def reboot(self) -> None:
        """Forget what was asked for, as a restarted autopilot does."""
        self._period_ns = {name: round(NS_PER_S / rate) for name, rate in _RATES_HZ.items()}

    def _count(self, message: Any) -> None:
        name = message.get_type()
        name += f" {message.command}" if name.startswith("COMMAND_") else ""
        self.received[name] = self.received.get(name, 0) + 1

    def _speaks(self, name: str) -> bool:
        if name == "RC_CHANNELS":
            return bool(self.rc_us)
        return name != "HEARTBEAT" or self.mute != "heartbeats"

    def _take(self) -> list[bytes]:
        out, self._out = self._out, []
        return [] if self.mute == "everything" else out

    def _watch_status(self) -> None:
        status = (self.commander.mode, self.commander.intention, self.commander.armed, self.commander.failsafe)
        if status != self._status or self._now_ns - self._status_ns >= _STATUS_PERIOD_NS:
            self._status, self._status_ns, self._status_is_new = status, self._now_ns, True

    # What the companion sends.

    def _on_heartbeat(self, message: Any) -> None:
        self.peer_heartbeats += 1

    def _on_timesync(self, message: Any) -> None:
        if message.tc1 == 0:
            self._mav.send(self._mav.timesync_encode(self._now_ns, message.ts1))
        else:
            self.timesync_answers += 1
            self._clock_offset_ns = message.tc1 - message.ts1  # ts1 is our own time when we asked

    def _on_onboard_computer_status(self, message: Any) -> None:
        self.onboard_statuses += 1

    def _on_odometry(self, message: Any) -> None:
        """PX4 takes vision in LOCAL_FRD or LOCAL_NED with BODY_FRD and drops every other frame without a word."""
        frames = (mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_LOCAL_NED)
        if message.frame_id in frames and message.child_frame_id == mavlink.MAV_FRAME_BODY_FRD:
            self.vision, self.visions = message, self.visions + 1
            if self._clock_offset_ns is not None:
                theirs_ns = self._now_ns + self._clock_offset_ns
                self.vision_age_s = (theirs_ns - message.time_usec * 1000) / NS_PER_S

    def _on_set_position_target_local_ned(self, message: Any) -> None:
        if message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
            return
        self.commander.set_point(_demand(message), self._now_ns)

    def _on_command_int(self, message: Any) -> None:
        self._command(message)

    def _on_command_long(self, message: Any) -> None:
        self._command(message)

    def _command(self, message: Any) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.command == mavlink.MAV_CMD_DO_SET_MODE:
            if not self.ignore_mode_commands:
                # PX4's MAVLink module accepts at once, its commander answers later: only the second one tells.
                self._acknowledge(message.command, Result.ACCEPTED, sender)
                self._acknowledge(message.command, self._set_mode(message), sender)
            return
        self._acknowledge(message.command, self._other_command(message), sender)

    def _set_mode(self, message: Any) -> Result:
        wanted = (int(message.param2), int(message.param3))
        if not int(message.param1) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Result.DENIED
        mode = next((mode for mode in Mode if mode.value == wanted), None)
        return Result.DENIED if mode is None else self.commander.command_mode(mode, self._now_ns)

    def _other_command(self, message: Any) -> Result:
        commander, command = self.commander, message.command
        if command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            return commander.arm(self._now_ns) if message.param1 > 0.5 else commander.disarm()
        if command == mavlink.MAV_CMD_NAV_TAKEOFF:
            return commander.command_takeoff()
        if command == mavlink.MAV_CMD_NAV_LAND:
            return commander.command_mode(Mode.LAND, self._now_ns)
        if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return self._set_interval(int(message.param1), message.param2)
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            return self._request_message(int(message.param1))
        if command == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return self._request_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        return Result.UNSUPPORTED

    def _set_interval(self, message_id: int, interval_us: float) -> Result:
        name = _name(message_id)
        if name not in _RATES_HZ or name == "HEARTBEAT":  # PX4 refuses to change the heartbeat's
            return Result.FAILED
        default_ns = round(NS_PER_S / _RATES_HZ[name])
        self._period_ns[name] = default_ns if interval_us == 0 else round(interval_us * 1000)
        self._due_ns[name] = self._now_ns
        return Result.ACCEPTED

    def _request_message(self, message_id: int) -> Result:
        name = _name(message_id)
        if name == "AUTOPILOT_VERSION":
            self._mav.send(self._autopilot_version())
        elif name in self._encoders:
            if not self._speaks(name):
                return Result.FAILED
            self._mav.send(self._encoders[name]())
        else:
            return Result.UNSUPPORTED
        return Result.ACCEPTED

    def _acknowledge(self, command: int, result: Result, sender: tuple[int, int]) -> None:
        self._mav.send(self._mav.command_ack_encode(command, int(result), 0, 0, *sender))

    # Parameters: PX4 puts the bytes of an INT32 into the float field.

    def _on_param_request_list(self, message: Any) -> None:
        for name in self.commander.parameters:
            self._send_parameter(name)

    def _on_param_request_read(self, message: Any) -> None:
        names = list(self.commander.parameters)
        name = message.param_id if message.param_index < 0 else None
        if name is None and message.param_index < len(names):
            name = names[message.param_index]
        if name in self.commander.parameters and not self.ignore_parameter_requests:
            self._send_parameter(name)

    def _on_param_set(self, message: Any) -> None:
        name = message.param_id
        if name not in self.commander.parameters:
            return
        is_integer = isinstance(self.commander.parameters[name], int)
        raw = struct.pack("<f", message.param_value)
        self.commander.parameters[name] = struct.unpack("<i", raw)[0] if is_integer else message.param_value
        self._send_parameter(name)

    def _send_parameter(self, name: str) -> None:
        value, names = self.commander.parameters[name], list(self.commander.parameters)
        kind = mavlink.MAV_PARAM_TYPE_INT32 if isinstance(value, int) else mavlink.MAV_PARAM_TYPE_REAL32
        field = struct.unpack("<f", struct.pack("<i", value))[0] if isinstance(value, int) else value
        self._mav.send(self._mav.param_value_encode(name.encode(), field, kind, len(names), names.index(name)))

    # What the autopilot sends.

    @property
    def _boot_ms(self) -> int:
        return (self._now_ns - self._boot_ns) // 1_000_000 & 0xFFFFFFFF

    def _heartbeat(self) -> Any:
        commander = self.commander
        base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
            mavlink.MAV_MODE_FLAG_SAFETY_ARMED if commander.armed else 0
        )
        status = mavlink.MAV_STATE_ACTIVE if commander.armed else mavlink.MAV_STATE_STANDBY
        status = mavlink.MAV_STATE_CRITICAL if commander.failsafe else status
        return self._mav.heartbeat_encode(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, base_mode, commander.mode.custom_mode, status
        )

    def _current_mode(self) -> Any:
        commander = self.commander
        return self._mav.current_mode_encode(0, commander.mode.custom_mode, commander.intention.custom_mode)

    def _sys_status(self) -> Any:
        sensors = 0x0020_FC2F  # gyro, accelerometer, compass, barometer, GPS, controllers, motors, AHRS
        voltage_mv, percent = self._battery()
        return self._mav.sys_status_encode(sensors, sensors, sensors, 300, voltage_mv, 1200, percent, 0, 0, 0, 0, 0, 0)

    def _battery(self) -> tuple[int, int]:
        return round(14000 + 2800 * self.battery_remaining), round(100 * self.battery_remaining)

    def _battery_status(self) -> Any:
        voltage_mv, percent = self._battery()
        voltages = [voltage_mv // 4] * 4 + [65535] * 6
        return self._mav.battery_status_encode(0, 1, 1, 2500, voltages, 1200, 100, -1, percent)

    def _extended_sys_state(self) -> Any:
        commander = self.commander
        landed = {
            Mode.TAKEOFF: mavlink.MAV_LANDED_STATE_TAKEOFF,
            Mode.LAND: mavlink.MAV_LANDED_STATE_LANDING,
        }.get(commander.mode, mavlink.MAV_LANDED_STATE_IN_AIR)
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND if commander.landed else landed
        return self._mav.extended_sys_state_encode(0, landed)

    def _local_position_ned(self) -> Any:
        airframe = self.commander.airframe
        return self._mav.local_position_ned_encode(
            self._boot_ms, *_ned(airframe.estimated_p_enu_m), *_ned(airframe.v_enu_m_s)
        )

    def _attitude(self) -> Any:
        heading_rad = math.remainder(math.pi / 2 - self.commander.airframe.yaw_enu_rad, math.tau)
        return self._mav.attitude_encode(self._boot_ms, 0.0, 0.0, heading_rad, 0.0, 0.0, 0.0)

    def _global(self) -> tuple[int, int, int]:
        east, north, up = self.commander.airframe.estimated_p_enu_m
        lat = _HOME_LAT_DEG + math.degrees(north / _EARTH_RADIUS_M)
        lon = _HOME_LON_DEG + math.degrees(east / _EARTH_RADIUS_M / math.cos(math.radians(_HOME_LAT_DEG)))
        return round(lat * 1e7), round(lon * 1e7), round((_HOME_ALT_M + up) * 1000)

    def _global_position_int(self) -> Any:
        lat, lon, alt = self._global()
        airframe = self.commander.airframe
        v_cm_s = [round(100 * v) for v in _ned(airframe.v_enu_m_s)]
        heading_cdeg = round(math.degrees(math.pi / 2 - airframe.yaw_enu_rad) % 360 * 100) % 36000
        relative_mm = round(airframe.estimated_p_enu_m[2] * 1000)
        return self._mav.global_position_int_encode(self._boot_ms, lat, lon, alt, relative_mm, *v_cm_s, heading_cdeg)

    def _gps_raw_int(self) -> Any:
        return self._mav.gps_raw_int_encode(self._now_ns // 1000, 3, *self._global(), 80, 120, 0, 65535, 14)

    def _home_position(self) -> Any:
        lat, lon, alt = round(_HOME_LAT_DEG * 1e7), round(_HOME_LON_DEG * 1e7), round(_HOME_ALT_M * 1000)
        return self._mav.home_position_encode(lat, lon, alt, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0)

    def _timesync(self) -> Any:
        return self._mav.timesync_encode(0, self._now_ns)

    def _estimator_status(self) -> Any:
        flags = 0x1 | 0x2 | 0x4 | 0x8 | 0x10 | 0x20 if self.estimator_healthy else 0x1 | 0x4 | 0x80
        return self._mav.estimator_status_encode(self._now_ns // 1000, flags, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0, 0.3, 0.4)

    def _rc_channels(self) -> Any:
        channels = [*self.rc_us, *[65535] * 18][:18]
        return self._mav.rc_channels_encode(self._boot_ms, len(self.rc_us), *channels, 255)

    def _odometry(self) -> Any:
        """The estimator's own output, as PX4 streams it: LOCAL_NED, body velocity, attitude level."""
        airframe = self.commander.airframe
        heading_rad = math.pi / 2 - airframe.yaw_enu_rad
        north, east, down = _ned(airframe.v_enu_m_s)
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        velocity = (cos * north + sin * east, -sin * north + cos * east, down)
        q = (math.cos(heading_rad / 2), 0.0, 0.0, math.sin(heading_rad / 2))
        covariance = [0.0] * 21
        return self._mav.odometry_encode(
            self._now_ns // 1000, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD,
            *_ned(airframe.estimated_p_enu_m), q, *velocity, 0.0, 0.0, 0.0, covariance, covariance, 0,
            mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        )  # fmt: skip

    def _autopilot_version(self) -> Any:
        version = 1 << 24 | 16 << 16 | 255  # 1.16.0, a release
        return self._mav.autopilot_version_encode(
            _CAPABILITIES, version, version, version, 0, bytes(8), bytes(8), bytes(8), 0, 0, 1, bytes(18)
        )


def _name(message_id: int) -> str:
    kind = mavlink.mavlink_map.get(message_id)
    return str(kind.msgname) if kind is not None else ""


def _ned(v_enu: Vector3) -> Vector3:
    east, north, up = v_enu
    return (north, east, -up)


def _demand(message: Any) -> Demand:
    mask = int(message.type_mask)
    px, py, pz = (bool(mask & bit) for bit in (1, 2, 4))
    vx, vy, vz = (bool(mask & bit) for bit in (8, 16, 32))
    north, east, down = finite_or_none((message.x, message.y, message.z), (px, py, pz))
    v_north, v_east, v_down = finite_or_none((message.vx, message.vy, message.vz), (vx, vy, vz))
    yaw = None if mask & 1024 or not math.isfinite(message.yaw) else math.pi / 2 - message.yaw
    p_enu_m = (east, north, None if down is None else -down)
    return Demand(p_enu_m, (v_east or 0.0, v_north or 0.0, -(v_down or 0.0)), yaw)
