"""A companion that speaks raw MAVLink to the mock, without sockets and with time as a number."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.core.clock import NS_PER_S
from companion.sim.px4.autopilot import Px4
from companion.sim.px4.commander import Mode

_NUMBERS = {message.msgname: number for number, message in mavlink.mavlink_map.items()}
_NUMBER = slice(7, 10)
"""Where the number of a message stands in a MAVLink 2 frame, little-endian."""
_STEP_NS = NS_PER_S // 100
POSITION_VELOCITY_YAW = 64 | 128 | 256 | 2048
OFFBOARD, HOLD, LAND = (6, 0), (4, 3), (4, 6)


class Client:
    """Keeps all it hears, and decodes what it is asked for: a flight is thousands of messages that no test looks at."""

    def __init__(self, **options: Any) -> None:
        self.now_ns = 6844 * NS_PER_S
        self.px4 = Px4(self.now_ns, **{"drift_m": 0.0} | options)
        self.datagrams: list[bytes] = []
        self._mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=195)

    def mode(self) -> Mode:
        return self.px4.commander.mode

    def run(self, seconds: float, stream_hz: float = 0.0, point: tuple[float, ...] = (0, 0, -1.5, 0, 0, 0, 0)) -> None:
        """Let time pass, with a stream of set points (north, east, down, their velocities, heading)."""
        end_ns, next_ns = self.now_ns + round(seconds * NS_PER_S), self.now_ns
        while self.now_ns < end_ns:
            self.now_ns += _STEP_NS
            self._hear(self.px4.step(self.now_ns))
            self.pass_time()
            if stream_hz and self.now_ns >= next_ns:
                next_ns += round(NS_PER_S / stream_hz)
                self.set_point(*point)

    def pass_time(self) -> None:
        """What else happens as time goes on."""

    def set_point(self, *point: float, mask: int = POSITION_VELOCITY_YAW, frame: int = 1) -> None:
        x, y, z, vx, vy, vz, yaw = point
        self.send(
            self._mav.set_position_target_local_ned_encode(0, 1, 1, frame, mask, x, y, z, vx, vy, vz, 0, 0, 0, yaw, 0)
        )

    def command(self, command: int, *parameters: float) -> list[int]:
        """The results of all acknowledgements."""
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        before = len(self.datagrams)
        self.send(self._mav.command_long_encode(1, 1, command, 0, *padded))
        acks = self.messages("COMMAND_ACK", before)
        assert all(m.command == command for m in acks)
        return [int(m.result) for m in acks]

    def set_mode(self, mode: tuple[int, int]) -> list[int]:
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, *mode)

    def take_off(self) -> None:
        assert self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == [0]
        assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF) == [0]
        self.run(5)
        assert self.mode() is Mode.HOLD and not self.px4.commander.landed

    def go_offboard(self) -> None:
        self.run(0.5, stream_hz=20)
        assert self.set_mode(OFFBOARD) == [0, 0]
        self.run(0.5, stream_hz=20)

    def messages(self, name: str, first: int = 0) -> list[Any]:
        """Those of a name, from the datagram numbered `first` on."""
        number = _NUMBERS[name].to_bytes(3, "little")
        wanted = (data for data in self.datagrams[first:] if data[_NUMBER] == number)
        return [m for data in wanted for m in mavlink.MAVLink(None).parse_buffer(data) or []]

    def decoded(self, first: int = 0) -> list[Any]:
        """All messages from the datagram numbered `first` on."""
        return [m for data in self.datagrams[first:] for m in mavlink.MAVLink(None).parse_buffer(data) or []]

    def order(self, text: str) -> None:
        assert self.px4.order(text) is None

    def flags(self) -> int:
        return int(self.messages("ESTIMATOR_STATUS")[-1].flags)

    def send(self, message: Any) -> None:
        self._hear(self.px4.receive(message.pack(self._mav), self.now_ns))

    def _hear(self, datagrams: list[bytes]) -> None:
        assert all(data[0] == mavlink.PROTOCOL_MARKER_V2 for data in datagrams)
        self.datagrams += datagrams


GPS_DENIED = {
    "SYS_HAS_GPS": 0,
    "EKF2_GPS_CTRL": 0,
    "EKF2_EV_CTRL": 11,
    "EKF2_HGT_REF": 3,
    "COM_OBL_RC_ACT": 4,
    "MIS_TAKEOFF_ALT": 2.0,
}


class Seeing(Client):
    """A client whose camera sees where the vehicle is, `off_m` (East, North, Up) beside the truth, at 30 Hz."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"parameters": GPS_DENIED} | options)
        self.sees = True
        self.off_m = (0.0, 0.0, 0.0)
        self.reset_counter = 0
        self.frame = int(mavlink.MAV_FRAME_LOCAL_NED)
        self.stamp_ahead_s = 0.0
        """How far the stamps are ahead of the vehicle's own clock."""
        self._next_ns = self.now_ns

    def pass_time(self) -> None:
        if not self.sees or self.now_ns < self._next_ns:
            return
        self._next_ns += NS_PER_S // 30
        east, north, up = (p + o for p, o in zip(self.px4.commander.airframe.p_enu_m, self.off_m, strict=True))
        stamp_us = round(self.px4.link.clock.ns(self.now_ns) / 1000 + 1e6 * self.stamp_ahead_s)
        unknown = [float("nan")] * 21
        self.send(
            self._mav.odometry_encode(
                max(0, stamp_us), self.frame, mavlink.MAV_FRAME_BODY_FRD, north, east, -up, (1, 0, 0, 0),
                0, 0, 0, 0, 0, 0, unknown, unknown, self.reset_counter, 3,
            )
        )  # fmt: skip

    def set_origin(self, altitude_m: float = 0.0) -> None:
        self.send(self._mav.set_gps_global_origin_encode(1, 474000000, 85000000, round(1000 * altitude_m)))

    def estimate_m(self) -> tuple[float, float, float]:
        return self.px4.commander.airframe.estimated_p_enu_m

    def truth_m(self) -> tuple[float, float, float]:
        return self.px4.commander.airframe.p_enu_m
