"""The messages the mock sends: their rates, and what each says of the commander and its estimator.

NED is written out here by hand instead of taken from `wsr.frames`, so that a slip there cannot cancel itself between
the edge under test and its counterpart. Longer than other modules: one method a message.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.sim.px4.arming import prearm_health
from companion.sim.px4.clocks import PowerUpClock
from companion.sim.px4.commander import Commander, Mode

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
_GEOID_M = 47.5
"""Above the ellipsoid there."""
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


_FIRMWARE: Final = 1 << 24 | 16 << 16 | 1 << 8 | 255
"""1.16.1, a release."""
_FIRST_HEARTBEAT_NS = NS_PER_S // 2
"""Other messages are on their way before the first heartbeat."""


class Streams:
    """What is due when, and each message. `batteries` are remaining shares by id; None is told as unknown (-1)."""

    def __init__(self, *, commander: Commander, clock: PowerUpClock, mav: Any, kind: int, now_ns: int) -> None:
        self._commander = commander
        self._clock = clock
        self._mav = mav
        self._kind = kind
        self.batteries: dict[int, float | None] = {0: 0.95}
        self.rc_us: list[int] = []
        self.has_heartbeats = True
        self._encoders: dict[str, Callable[[], Any]] = {name: getattr(self, f"_{name.lower()}") for name in _RATES_HZ}
        self.boot(now_ns)

    def boot(self, now_ns: int) -> None:
        """Default rates again: what was asked for is forgotten."""
        self._now_ns = self._status_ns = now_ns
        self._period_ns = {name: round(NS_PER_S / rate) for name, rate in _RATES_HZ.items()}
        self._due_ns = dict.fromkeys(_RATES_HZ, now_ns) | {"HEARTBEAT": now_ns + _FIRST_HEARTBEAT_NS}
        self._status: tuple[object, ...] = ()
        self._status_is_new = True

    def send_due(self, now_ns: int) -> None:
        self._now_ns = now_ns
        self._watch_status()
        for name, due_ns in self._due_ns.items():
            period_ns = self._period_ns[name]
            if now_ns < due_ns or period_ns <= 0 or (name == "CURRENT_MODE" and not self._status_is_new):
                continue
            self._due_ns[name] = max(due_ns + period_ns, now_ns - period_ns)
            if self._speaks(name):
                self._send(name)
                self._status_is_new &= name != "CURRENT_MODE"

    def set_interval(self, message_id: int, interval_us: float, now_ns: int) -> bool:
        name = _name(message_id)
        if name not in _RATES_HZ or name == "HEARTBEAT":  # PX4 refuses to change the heartbeat's
            return False
        default_ns = round(NS_PER_S / _RATES_HZ[name])
        self._period_ns[name] = default_ns if interval_us == 0 else round(interval_us * 1000)
        self._due_ns[name] = now_ns
        return True

    def send_requested(self, message_id: int, now_ns: int) -> bool | None:
        """False when there is nothing to say of it now, None when it is no message of ours."""
        name, self._now_ns = _name(message_id), now_ns
        if name == "AUTOPILOT_VERSION":
            self._mav.send(self._autopilot_version())
            return True
        if name not in self._encoders:
            return None
        if self._speaks(name):
            self._send(name)
            return True
        return False

    def _send(self, name: str) -> None:
        if name == "BATTERY_STATUS":
            for battery_id, remaining in self.batteries.items():
                self._mav.send(self._battery_message(battery_id, remaining))
        else:
            self._mav.send(self._encoders[name]())

    def _speaks(self, name: str) -> bool:
        match name:
            case "HEARTBEAT":
                return self.has_heartbeats
            case "RC_CHANNELS":
                return bool(self.rc_us)
            case "GPS_RAW_INT":
                return self._commander.estimator.uses_gps
            case "GLOBAL_POSITION_INT" | "HOME_POSITION":
                return self._commander.estimator.has_global_position
            case _:
                return True

    def _watch_status(self) -> None:
        status = (self._commander.mode, self._commander.intention, self._commander.armed, self._commander.failsafe)
        if status != self._status or self._now_ns - self._status_ns >= _STATUS_PERIOD_NS:
            self._status, self._status_ns, self._status_is_new = status, self._now_ns, True

    @property
    def _boot_ms(self) -> int:
        return self._own_ns // 1_000_000 & 0xFFFFFFFF

    @property
    def _own_ns(self) -> int:
        return self._clock.ns(self._now_ns)

    def _heartbeat(self) -> Any:
        commander = self._commander
        base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
            mavlink.MAV_MODE_FLAG_SAFETY_ARMED if commander.armed else 0
        )
        at_rest = mavlink.MAV_STATE_STANDBY if commander.can_arm else mavlink.MAV_STATE_UNINIT
        status = mavlink.MAV_STATE_ACTIVE if commander.armed else at_rest
        status = mavlink.MAV_STATE_CRITICAL if commander.failsafe else status
        vehicle = mavlink.MAV_TYPE_GROUND_ROVER if commander.drives else mavlink.MAV_TYPE_QUADROTOR
        return self._mav.heartbeat_encode(vehicle, self._kind, base_mode, commander.mode.custom_mode, status)

    def _current_mode(self) -> Any:
        commander = self._commander
        return self._mav.current_mode_encode(0, commander.mode.custom_mode, commander.intention.custom_mode)

    def _sys_status(self) -> Any:
        sensors = 0x0020_FC2F  # gyro, accelerometer, compass, barometer, GPS, controllers, motors, AHRS
        voltage_mv, percent = _charge(next(iter(self.batteries.values()), None))
        health = sensors | prearm_health(self._commander)
        return self._mav.sys_status_encode(sensors, sensors, health, 300, voltage_mv, 1200, percent, 0, 0, 0, 0, 0, 0)

    def _battery_status(self) -> Any:
        return self._battery_message(*next(iter(self.batteries.items())))

    def _battery_message(self, battery_id: int, remaining: float | None) -> Any:
        voltage_mv, percent = _charge(remaining)
        voltages = [voltage_mv // 4] * 4 + [65535] * 6
        return self._mav.battery_status_encode(battery_id, 1, 1, 2500, voltages, 1200, 100, -1, percent)

    def _extended_sys_state(self) -> Any:
        commander = self._commander
        landed = {
            Mode.TAKEOFF: mavlink.MAV_LANDED_STATE_TAKEOFF,
            Mode.LAND: mavlink.MAV_LANDED_STATE_LANDING,
        }.get(commander.mode, mavlink.MAV_LANDED_STATE_IN_AIR)
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND if commander.landed else landed
        return self._mav.extended_sys_state_encode(0, landed)

    def _local_position_ned(self) -> Any:
        airframe = self._commander.airframe
        return self._mav.local_position_ned_encode(
            self._boot_ms, *_ned(airframe.estimated_p_enu_m), *_ned(airframe.v_enu_m_s)
        )

    def _attitude(self) -> Any:
        heading_rad = math.remainder(math.pi / 2 - self._commander.airframe.yaw_enu_rad, math.tau)
        return self._mav.attitude_encode(self._boot_ms, 0.0, 0.0, heading_rad, 0.0, 0.0, 0.0)

    def _global(self) -> tuple[int, int, int]:
        east, north, up = self._commander.airframe.estimated_p_enu_m
        lat = _HOME_LAT_DEG + math.degrees(north / _EARTH_RADIUS_M)
        lon = _HOME_LON_DEG + math.degrees(east / _EARTH_RADIUS_M / math.cos(math.radians(_HOME_LAT_DEG)))
        return round(lat * 1e7), round(lon * 1e7), round((_HOME_ALT_M + up) * 1000)

    def _global_position_int(self) -> Any:
        lat, lon, alt = self._global()
        airframe = self._commander.airframe
        v_cm_s = [round(100 * v) for v in _ned(airframe.v_enu_m_s)]
        heading_cdeg = round(math.degrees(math.pi / 2 - airframe.yaw_enu_rad) % 360 * 100) % 36000
        relative_mm = round(airframe.estimated_p_enu_m[2] * 1000)
        return self._mav.global_position_int_encode(self._boot_ms, lat, lon, alt, relative_mm, *v_cm_s, heading_cdeg)

    def _gps_raw_int(self) -> Any:
        lat, lon, alt_mm = self._global()
        ellipsoid_mm = alt_mm + round(1e3 * _GEOID_M)
        accuracies = (800, 1200)
        return self._mav.gps_raw_int_encode(
            self._own_ns // 1000, 3, lat, lon, alt_mm, 80, 120, 0, 65535, 14, ellipsoid_mm, *accuracies
        )

    def _home_position(self) -> Any:
        lat, lon, alt = round(_HOME_LAT_DEG * 1e7), round(_HOME_LON_DEG * 1e7), round(_HOME_ALT_M * 1000)
        return self._mav.home_position_encode(lat, lon, alt, 0, 0, 0, (1, 0, 0, 0), 0, 0, 0)

    def _timesync(self) -> Any:
        return self._mav.timesync_encode(0, self._own_ns)

    def _estimator_status(self) -> Any:
        flags = self._commander.estimator.flags(self._commander.is_at_rest)
        return self._mav.estimator_status_encode(self._own_ns // 1000, flags, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0, 0.3, 0.4)

    def _rc_channels(self) -> Any:
        channels = [*self.rc_us, *[65535] * 18][:18]
        return self._mav.rc_channels_encode(self._boot_ms, len(self.rc_us), *channels, 255)

    def _odometry(self) -> Any:
        """The estimator's own output, as PX4 streams it: LOCAL_NED, body velocity, attitude level."""
        airframe = self._commander.airframe
        heading_rad = math.pi / 2 - airframe.yaw_enu_rad
        north, east, down = _ned(airframe.v_enu_m_s)
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        velocity = (cos * north + sin * east, -sin * north + cos * east, down)
        q = (math.cos(heading_rad / 2), 0.0, 0.0, math.sin(heading_rad / 2))
        covariance = [0.0] * 21
        return self._mav.odometry_encode(
            self._own_ns // 1000, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD,
            *_ned(airframe.estimated_p_enu_m), q, *velocity, 0.0, 0.0, 0.0, covariance, covariance,
            self._commander.estimator.resets & 0xFF,
            mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
        )  # fmt: skip

    def _autopilot_version(self) -> Any:
        version = _FIRMWARE
        return self._mav.autopilot_version_encode(
            _CAPABILITIES, version, version, version, 0, bytes(8), bytes(8), bytes(8), 0, 0, 1, bytes(18)
        )


def _charge(remaining: float | None) -> tuple[int, int]:
    """Voltage [mV] and percent."""
    return (0, -1) if remaining is None else (round(14000 + 2800 * remaining), round(100 * remaining))


def _name(message_id: int) -> str:
    kind = mavlink.mavlink_map.get(message_id)
    return str(kind.msgname) if kind is not None else ""


def _ned(v_enu: Vector3) -> Vector3:
    east, north, up = v_enu
    return (north, east, -up)
