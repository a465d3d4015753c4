"""A real PX4 that runs already: a relay on its offboard link, a ground station, and its true state for the world.

One thread serves three links: what PX4 sends to 14540 goes to the service and back (so a test can cut it and sees every
set point), 14550 is the ground station's, and HIL_STATE_QUATERNION at 19410 is where the simulated vehicle truly is.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import select
import socket
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import development as mavlink

from companion.autopilot.px4_modes import flight_mode
from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode, Vector3
from companion.host.priority import LOOP_PRIORITY
from companion.sim import truth
from companion.sim.px4.parameters import field_and_kind
from companion.sim.stage import free_udp_port

OFFBOARD_PORT: Final = 14540
_GROUND_PORT: Final = 14550
_TRUTH_PORT: Final = 19410
_EARTH_M: Final = 6_371_000.0
_SET_POINT: Final = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
_CORRECTED: Final = 0.1
"""Of the difference to each reported position, which is rounded to a centimetre; the speed is finer."""

_WANTED: Final = (
    (3, mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, 10_000),
    (2, mavlink.MAVLINK_MSG_ID_CURRENT_MODE, 50_000),
    (2, mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, 500_000),
    (2, mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 200_000),
)
"""Of which link (as in `_sockets`), what, and how often [us]."""

Address = tuple[str, int]


def why_no_px4() -> str:
    """Empty when MAVLink 2 of a PX4 arrives on all three links."""
    for port in (OFFBOARD_PORT, _GROUND_PORT, _TRUTH_PORT):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError as error:
                return f"udp port {port}: {error.strerror}"
            probe.settimeout(2.0)
            try:
                datagram = probe.recv(2048)
            except TimeoutError:
                return f"no PX4 sends to 127.0.0.1:{port}"
        if datagram[:1] != b"\xfd":
            return f"what arrives at 127.0.0.1:{port} is no MAVLink 2"
    return ""


class RealPx4:
    """Used as a context manager. Everything it tells is the newest heard; times are of the monotonic clock [s]."""

    def __init__(self) -> None:
        self.is_cut = False
        """Nothing passes between PX4 and the service, either way."""
        self.modes: list[tuple[float, FlightMode]] = []
        self.intended: FlightMode | None = None
        self.offboard_in_air: list[float] = []
        """When OFFBOARD began in the air. PX4 goes back to it on the ground, after a landing that began in it."""
        self.armed = False
        self.setpoints: list[float] = []
        self.told: dict[str, Any] = {}
        """The newest message of the ground station's link by its type."""
        self.acks: dict[int, int] = {}
        self.parameters: dict[str, int | float] = {}
        self.estimator: list[tuple[float, int]] = []
        """Flags of ESTIMATOR_STATUS."""
        self.started: list[float] = []
        """When its clock (SYSTEM_TIME) was seen to begin anew."""
        self.service_port = free_udp_port("127.0.0.1")
        self._sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(4)]
        self._offboard, self._service, self._ground, self._truth = self._sockets
        for one, port in zip(self._sockets, (OFFBOARD_PORT, 0, _GROUND_PORT, _TRUTH_PORT), strict=True):
            one.bind(("127.0.0.1", port))
        self._peers: dict[socket.socket, Address] = {}
        self._codecs = {one: mavlink.MAVLink(None, 255, 190) for one in self._sockets}
        for codec in self._codecs.values():
            codec.robust_parsing = True
        self._lock = threading.Lock()
        self._out = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)
        self._world = ""
        self._place = Place()
        self._beat_s = self._stick_s = 0.0
        self._is_over = False
        self._thread = threading.Thread(target=self._serve, name="px4")

    def __enter__(self) -> RealPx4:
        _before_others()  # this thread as well: it has the interpreter's lock at times
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over = True
        self._thread.join()
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        for one in (*self._sockets, self._out):
            one.close()

    @property
    def mode(self) -> FlightMode | None:
        return self.modes[-1][1] if self.modes else None

    @property
    def p_enu_m(self) -> Vector3:
        """Where it truly is, from where it stood when it was first heard."""
        return self._place.p_enu_m

    @property
    def landed(self) -> bool:
        state = self.told.get("EXTENDED_SYS_STATE")
        return state is not None and state.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND

    def feed(self, world: str) -> None:
        """From now on the world hears where the vehicle is; it is where the vehicle starts from now."""
        self._place = Place()
        self._world = world

    def setpoints_after(self, at_s: float) -> list[float]:
        """How long after it each later one was sent [s]."""
        return [round(t_s - at_s, 3) for t_s in self.setpoints if t_s > at_s]

    async def until(self, what: str, condition: Callable[[], bool], timeout_s: float) -> float:
        """Seconds it took."""
        began_s = time.monotonic()
        while not condition():
            if time.monotonic() - began_s > timeout_s:
                raise AssertionError(f"not {what} within {timeout_s:g} s; modes {self.modes[-6:]}, armed {self.armed}")
            await asyncio.sleep(0.01)
        return time.monotonic() - began_s

    async def in_mode(self, *modes: FlightMode, timeout_s: float) -> float:
        return await self.until(f"in {modes}", lambda: self.mode in modes, timeout_s)

    async def down(self, timeout_s: float = 60.0) -> None:
        await self.until("landed and disarmed", lambda: self.landed and not self.armed, timeout_s)

    async def command(self, number: int, *values: float) -> int:
        """From the ground station; MAV_RESULT of PX4."""
        self.acks.pop(number, None)
        for _ in range(5):
            padded = (*values, *(7 - len(values)) * (0.0,))
            self._send(self._ground, mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
            with contextlib.suppress(AssertionError):
                await self.until("answered", lambda: number in self.acks, 1.0)
                return self.acks[number]
        raise AssertionError(f"no answer to command {number}")

    async def choose(self, main: int, sub: int = 0) -> int:
        """A person chooses a mode at the ground station."""
        return await self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub)

    async def parameter(self, name: str) -> int | float:
        self.parameters.pop(name, None)
        read = mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1)
        await self._asked(read, name, lambda: name in self.parameters)
        return self.parameters[name]

    async def set(self, name: str, value: int | float) -> None:
        before = await self.parameter(name)
        field, kind = field_and_kind(type(before)(value))
        wanted = mavlink.MAVLink_param_set_message(1, 1, name.encode(), field, kind)
        # What was told last may still answer the reading, or somebody else's.
        await self._asked(wanted, name, lambda: math.isclose(self.parameters[name], value, rel_tol=1e-6))

    async def _asked(self, message: Any, name: str, is_told: Callable[[], bool]) -> None:
        for _ in range(5):
            self._send(self._ground, message)
            with contextlib.suppress(AssertionError):
                await self.until("told", is_told, 1.0)
                return
        raise AssertionError(f"{name}: PX4 tells {self.parameters.get(name)}")

    def _serve(self) -> None:
        _before_others()
        while not self._is_over:
            readable, _, _ = select.select(self._sockets, [], [], 0.05)
            for one in readable:
                with contextlib.suppress(ConnectionRefusedError):  # nobody listens where the last one went
                    self._take(one, *one.recvfrom(4096))
            self._speak(time.monotonic())

    def _take(self, one: socket.socket, datagram: bytes, sender: Address) -> None:
        self._peers[one] = sender
        if one is self._offboard:
            if not self.is_cut:
                self._service.sendto(datagram, ("127.0.0.1", self.service_port))
        elif one is self._service:
            self._count(datagram)
            if not self.is_cut and self._offboard in self._peers:
                self._offboard.sendto(datagram, self._peers[self._offboard])
        else:
            for message in self._codecs[one].parse_buffer(datagram) or ():
                (self._hear if one is self._ground else self._see)(message)

    def _count(self, datagram: bytes) -> None:
        if datagram[:1] == b"\xfd" and int.from_bytes(datagram[7:10], "little") == _SET_POINT:
            self.setpoints.append(time.monotonic())

    def _hear(self, message: Any) -> None:
        if message.get_srcSystem() != 1 or message.get_srcComponent() != 1:
            return
        kind, now_s = message.get_type(), time.monotonic()
        if kind == "HEARTBEAT":
            self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        elif kind == "CURRENT_MODE":
            mode = flight_mode(message.custom_mode)
            self.intended = flight_mode(message.intended_custom_mode)
            if mode is not self.mode:
                self.modes.append((now_s, mode))
                if mode is FlightMode.OFFBOARD and not self.landed:
                    self.offboard_in_air.append(now_s)
        elif kind == "COMMAND_ACK":
            self.acks[message.command] = message.result
        elif kind == "ESTIMATOR_STATUS":
            self.estimator.append((now_s, message.flags))
        elif kind == "PARAM_VALUE":
            value = message.param_value
            is_int = message.param_type == mavlink.MAV_PARAM_TYPE_INT32
            self.parameters[message.param_id] = _bits(value) if is_int else value
        elif kind == "SYSTEM_TIME" and kind in self.told and message.time_boot_ms < self.told[kind].time_boot_ms:
            self.started.append(now_s)
        self.told[kind] = message

    def _see(self, message: Any) -> None:
        if message.get_type() != "HIL_STATE_QUATERNION" or not self._world:
            return
        state = self._place.at(message, time.monotonic_ns(), self.mode, self.armed)
        with contextlib.suppress(OSError):  # the world has not begun or has ended
            self._out.sendto(truth.encode(state), self._world)

    def _speak(self, now_s: float) -> None:
        if now_s - self._beat_s >= 1.0:
            self._beat_s = now_s
            self._send(self._ground, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            for one, kind, every_us in _WANTED:
                asked = (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, kind, every_us, 0, 0, 0, 0, 0)
                self._send(self._sockets[one], mavlink.MAVLink_command_long_message(1, 1, *asked))
        if now_s - self._stick_s >= 0.05:
            self._stick_s = now_s  # a pilot is there, the sticks centred: one who goes is a failsafe of its own
            self._send(self._ground, mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))

    def _send(self, one: socket.socket, message: Any) -> None:
        if one in self._peers:
            with self._lock:
                packed = message.pack(self._codecs[one])
            one.sendto(packed, self._peers[one])


def file_parameters(path: Path) -> dict[str, float]:
    """Of a parameter file of QGroundControl."""
    rows = [line.split("\t") for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return {name: float(value) for _, _, name, value, _ in rows}


def _before_others() -> None:
    """The calling thread, where that is permitted: PX4 and the service run in real time, and this is the wire."""
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(LOOP_PRIORITY))


def _bits(value: float) -> int:
    return int(struct.unpack("<i", struct.pack("<f", value))[0])


class Place:
    """The vehicle's true way from where it was first seen, East, North, Up [m], smoother than PX4 rounds it."""

    def __init__(self) -> None:
        self.p_enu_m: Vector3 = (0.0, 0.0, 0.0)
        self._start: tuple[float, float, float] | None = None
        self._t_mono_ns = 0

    def at(self, message: Any, t_mono_ns: int, mode: FlightMode | None, armed: bool) -> truth.VehicleTruth:
        lat_rad, lon_rad, up_m = math.radians(message.lat * 1e-7), math.radians(message.lon * 1e-7), message.alt * 1e-3
        if self._start is None:
            self._start, self._t_mono_ns = (lat_rad, lon_rad, up_m), t_mono_ns
        start_lat, start_lon, start_up_m = self._start
        told = (
            (lon_rad - start_lon) * _EARTH_M * math.cos(start_lat),
            (lat_rad - start_lat) * _EARTH_M,
            up_m - start_up_m,
        )
        v_enu_m_s = (message.vy * 1e-2, message.vx * 1e-2, -message.vz * 1e-2)
        dt_s, self._t_mono_ns = (t_mono_ns - self._t_mono_ns) / NS_PER_S, t_mono_ns
        guessed = [p + v * dt_s for p, v in zip(self.p_enu_m, v_enu_m_s, strict=True)]
        east, north, up = (p + _CORRECTED * (m - p) for p, m in zip(guessed, told, strict=True))
        self.p_enu_m = (east, north, up)
        w, x, y, z = message.attitude_quaternion
        yaw_ned_rad = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return truth.VehicleTruth(
            t_mono_ns=t_mono_ns,
            p_enu_m=self.p_enu_m,
            v_enu_m_s=v_enu_m_s,
            yaw_enu_rad=math.pi / 2 - yaw_ned_rad,
            mode=str(mode or "").upper(),
            armed=armed,
            setpoints=0,
            setpoints_in_offboard=0,
            offboard_s=0.0,
        )
