"""The autopilot port on MAVSDK 4.1.

Only its plain callback interface is used. Its asyncio wrapper puts every message of a subscription into an unbounded
queue and its Offboard plugin repeats the last set point for ever by itself; here messages land in `Telemetry` on the
library's thread, and one call of `send_setpoint` is one SET_POSITION_TARGET_LOCAL_NED. `send_message` only appends to
the library's own bounded send queue (measured: it returns at once even when a serial line takes nothing), so it is
called on the event loop.

Commands are COMMAND_LONG messages, repeated by the waiting caller and not by the library: a command must not be sent
again after its caller gave up. NED exists from here outwards only.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import functools
import json
import logging
import socket
import threading
from collections.abc import Callable
from typing import Any, Final
from urllib.parse import urlsplit

import mavsdk
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkMessage

from companion.autopilot import px4_modes
from companion.autopilot.port import AutopilotError, GaveWayError
from companion.autopilot.telemetry import Telemetry
from companion.clock import NS_PER_S, Clock
from companion.messages import FlightMode, Setpoint, VehicleState
from wsr.frames import ned_from_enu, yaw_ned_from_enu

_LOG = logging.getLogger(__name__)
_NATIVE_LOG = logging.getLogger("mavsdk")

_CONFIRM_TIMEOUT_S = 3.0
_REPEAT_S = 0.5
_POLL_S = 0.01
_STALLED_S = 0.5
_CLOSE_TIMEOUT_S = 3.0
_TAKEOFF_SHARE = 0.7
_CLIMB_S_PER_M = 4.0
"""PX4 may be set to climb as slowly as this in takeoff."""

_CMD_NAV_TAKEOFF: Final = 22
_CMD_DO_SET_MODE: Final = 176
_CMD_ARM_DISARM: Final = 400
_CMD_SET_MESSAGE_INTERVAL: Final = 511
_CMD_REQUEST_MESSAGE: Final = 512
_HEARTBEAT: Final = 0
_MODE_FLAG_CUSTOM: Final = 1
_FRAME_LOCAL_NED: Final = 1
_PARAMETER_REAL32: Final = 9
_USE_POSITION_VELOCITY_YAW: Final = 64 | 128 | 256 | 2048
"""type_mask: set bits are ignored: the three accelerations and the yaw rate."""
_INTERVALS_US: Final = {
    32: 20_000,  # LOCAL_POSITION_NED
    30: 50_000,  # ATTITUDE
    436: 50_000,  # CURRENT_MODE: sent on each change of mode, while HEARTBEAT stays at 1 Hz
    245: 200_000,  # EXTENDED_SYS_STATE
    147: 1_000_000,  # BATTERY_STATUS
}
_RESULTS: Final = ("accepted", "temporarily rejected", "denied", "unsupported", "failed", "in progress", "cancelled")


class MavsdkAutopilot:
    """An `Autopilot` behind a MAVSDK connection such as udpin://127.0.0.1:14540 or serial:///dev/ttyS1:921600."""

    def __init__(self, url: str, clock: Clock) -> None:
        self._url = url
        self._clock = clock
        self._telemetry = Telemetry(clock.now_ns)
        self._mavsdk: Any = None
        self._direct: Any = None
        self._system_id = 0

    async def connect(self, timeout_s: float = 10.0) -> None:
        """Raises AutopilotError when the port is taken or no autopilot is heard within `timeout_s`."""
        _refuse_taken_port(self._url)
        _route_native_log()
        kind = mavsdk.ComponentType.COMPANION_COMPUTER
        self._mavsdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
        try:
            self._subscribe(await self._find_autopilot(timeout_s))
            await self._until(lambda state: state.heartbeat_mono_ns is not None, timeout_s, "the first heartbeat")
        except AutopilotError:
            await self.aclose()
            raise

    async def aclose(self) -> None:
        library, self._mavsdk, self._direct = self._mavsdk, None, None
        if library is None:
            return
        loop, closed = asyncio.get_running_loop(), asyncio.Event()

        def close() -> None:
            library.destroy()
            with contextlib.suppress(RuntimeError):  # the loop is gone: nobody waits any more
                loop.call_soon_threadsafe(closed.set)

        # Joins the library's threads. On a daemon thread: should it ever hang, it must not hold up the process's exit.
        threading.Thread(target=close, name="mavsdk-close", daemon=True).start()
        try:
            await asyncio.wait_for(closed.wait(), _CLOSE_TIMEOUT_S)
        except TimeoutError:
            _LOG.error("autopilot %s: the library did not close within %g s", self._url, _CLOSE_TIMEOUT_S)

    def state(self) -> VehicleState:
        return self._telemetry.state()

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Raises AutopilotError when the set point is not finite or the link is closed."""
        if not setpoint.is_finite():
            raise AutopilotError(f"set point {setpoint}: not finite; nothing was sent")
        x, y, z = ned_from_enu(setpoint.p_local_enu_m).tolist()
        vx, vy, vz = ned_from_enu(setpoint.v_local_enu_m_s).tolist()
        # Every field is written out: the library sends one that is missing as zero.
        self._send(
            "SET_POSITION_TARGET_LOCAL_NED",
            time_boot_ms=setpoint.t_mono_ns // 1_000_000 & 0xFFFFFFFF,
            target_system=self._system_id,
            target_component=1,
            coordinate_frame=_FRAME_LOCAL_NED,
            type_mask=_USE_POSITION_VELOCITY_YAW,
            x=x,
            y=y,
            z=z,
            vx=vx,
            vy=vy,
            vz=vz,
            afx=0.0,
            afy=0.0,
            afz=0.0,
            yaw=yaw_ned_from_enu(setpoint.yaw_enu_rad),
            yaw_rate=0.0,
        )

    async def arm(self) -> None:
        await self._command(_CMD_ARM_DISARM, (1,), lambda state: state.armed, "arming")

    async def takeoff(self, height_m: float) -> None:
        if self.state().in_air:
            return
        ground_m = self._height_m()
        await self._set_parameter("MIS_TAKEOFF_ALT", height_m)
        # NaN (null) leaves yaw, place and altitude to PX4, which then climbs to MIS_TAKEOFF_ALT.
        await self._command(
            _CMD_NAV_TAKEOFF,
            (0, 0, 0, None, None, None, None),
            lambda state: state.mode is FlightMode.TAKEOFF or state.in_air,
            "takeoff",
        )
        await self._until(
            lambda state: _hovers(state, ground_m + _TAKEOFF_SHARE * height_m),
            10 + _CLIMB_S_PER_M * height_m,
            f"takeoff: hovering at {height_m:g} m",
        )

    async def request_offboard(self) -> None:
        """Raises AutopilotError after 3 s, or as soon as the mode changes to anything else: somebody took over."""
        await self._set_mode(px4_modes.OFFBOARD, FlightMode.OFFBOARD)

    async def hold(self) -> None:
        await self._set_mode(px4_modes.HOLD, FlightMode.HOLD)

    async def land(self) -> None:
        """PX4 goes back to OFFBOARD after a landing that began there, so hold is asked for on the way."""
        if self.state().mode is FlightMode.OFFBOARD:
            try:
                await self._set_mode(px4_modes.HOLD, FlightMode.HOLD, timeout_s=_REPEAT_S)
            except GaveWayError:
                raise
            except AutopilotError:
                pass  # hold needs a position, landing does not
        await self._set_mode(px4_modes.LAND, FlightMode.LAND)

    async def parameter(self, name: str) -> int | float:
        self._telemetry.parameters.pop(name, None)
        request = {"param_id": name, "param_index": -1}
        await self._repeat(
            lambda: self._send_addressed("PARAM_REQUEST_READ", **request),
            lambda: name in self._telemetry.parameters,
            _CONFIRM_TIMEOUT_S,
            lambda: f"parameter {name}: no answer; the autopilot may not have it",
        )
        value = self._telemetry.parameters[name]
        if value is None:
            raise AutopilotError(f"parameter {name}: its value cannot be read over this library (it is not a number)")
        return value

    async def _set_parameter(self, name: str, value: float) -> None:
        self._telemetry.parameters.pop(name, None)
        fields = {"param_id": name, "param_value": value, "param_type": _PARAMETER_REAL32}
        await self._repeat(
            lambda: self._send_addressed("PARAM_SET", **fields),
            lambda: abs((self._telemetry.parameters.get(name) or 0.0) - value) < 1e-3,
            _CONFIRM_TIMEOUT_S,
            lambda: f"parameter {name}: not set to {value:g}; it is {self._telemetry.parameters.get(name)}",
        )

    def _height_m(self) -> float:
        p_m = self.state().p_local_enu_m
        return 0.0 if p_m is None else p_m[2]

    async def _set_mode(
        self, custom: tuple[int, int], wanted: FlightMode, timeout_s: float = _CONFIRM_TIMEOUT_S
    ) -> None:
        """Asks until the mode is `wanted`, or until somebody else has chosen a third one."""
        sent_ns, before = self._clock.now_ns(), self.state().mode

        def confirmed(state: VehicleState) -> bool:
            if state.mode not in (before, wanted):
                raise GaveWayError(f"mode {wanted}: the mode became {state.mode} meanwhile; somebody else decided")
            return state.mode is wanted and (state.mode_mono_ns or 0) > sent_ns

        await self._command(_CMD_DO_SET_MODE, (_MODE_FLAG_CUSTOM, *custom), confirmed, f"mode {wanted}", timeout_s)

    async def _command(
        self,
        command: int,
        parameters: tuple[float | None, ...],
        confirmed: Callable[[VehicleState], bool],
        what: str,
        timeout_s: float = _CONFIRM_TIMEOUT_S,
    ) -> None:
        self._telemetry.acknowledgements.pop(command, None)

        def reason() -> str:
            result = self._telemetry.acknowledgements.get(command)
            answer = "nothing" if result is None else f"{_RESULTS[result] if result < len(_RESULTS) else result}"
            return f"{what}: not confirmed by telemetry; mode is {self.state().mode}, its last answer was {answer}"

        await self._repeat(
            lambda: self._send_command(command, parameters), lambda: confirmed(self.state()), timeout_s, reason
        )

    async def _until(self, condition: Callable[[VehicleState], bool], timeout_s: float, what: str) -> None:
        await self._repeat(lambda: None, lambda: condition(self.state()), timeout_s, lambda: f"{what}: not seen")

    async def _repeat(
        self, send: Callable[[], None], done: Callable[[], bool], timeout_s: float, reason: Callable[[], str]
    ) -> None:
        """Send every half second until `done`. Raises AutopilotError with `reason` after `timeout_s`."""
        now_ns = self._clock.now_ns()
        deadline_ns, next_ns = now_ns + round(timeout_s * NS_PER_S), now_ns
        while True:
            if now_ns >= next_ns:
                send()
                next_ns += round(_REPEAT_S * NS_PER_S)
            await asyncio.sleep(_POLL_S)
            slept_ns, now_ns = self._clock.now_ns() - now_ns, self._clock.now_ns()
            if done():
                return
            if slept_ns > _STALLED_S * NS_PER_S:
                # The world has moved on meanwhile: what this was asked for in may be gone.
                raise GaveWayError(f"{reason()}; given up because this program stood still")
            if now_ns >= deadline_ns:
                raise AutopilotError(f"{reason()} (waited {timeout_s:g} s)")

    async def _find_autopilot(self, timeout_s: float) -> Any:
        try:
            # Opening a serial port may take a while.
            await asyncio.to_thread(self._mavsdk.add_any_connection_with_handle, self._url)
        except MavsdkError as error:
            wanted = "expected udpin://HOST:PORT or serial:///DEV:BAUD"
            raise AutopilotError(f"autopilot {self._url}: {error}; {wanted}") from error
        system = await self._first_autopilot(timeout_s)
        if system is None:
            raise AutopilotError(f"autopilot {self._url}: no heartbeat of an autopilot within {timeout_s:g} s")
        return system

    async def _first_autopilot(self, timeout_s: float) -> Any:
        loop = asyncio.get_running_loop()
        found: asyncio.Future[Any] = loop.create_future()

        def settle(system: Any) -> None:
            if not found.done():
                found.set_result(system)

        handle = self._mavsdk.first_autopilot_async(timeout_s, lambda system: loop.call_soon_threadsafe(settle, system))
        try:
            return await found
        finally:
            self._mavsdk.cancel_first_autopilot(handle)

    def _subscribe(self, system: Any) -> None:
        self._system_id = system.get_system_id()
        system.enable_timesync()
        self._direct = MavlinkDirect(system)
        for name in self._telemetry.message_names:
            self._direct.subscribe_message(name, self._take)
        for message_id, interval_us in _INTERVALS_US.items():
            self._send_command(_CMD_SET_MESSAGE_INTERVAL, (message_id, interval_us))
        self._send_command(_CMD_REQUEST_MESSAGE, (_HEARTBEAT,))

    def _take(self, message: MavlinkMessage, user_data: object) -> None:
        self._telemetry.take(message.message_name, message.component_id, message.fields_json)

    def _send_command(self, command: int, parameters: tuple[float | None, ...]) -> None:
        padded = (*parameters, *(0,) * (7 - len(parameters)))
        fields: dict[str, Any] = {f"param{i}": value for i, value in enumerate(padded, 1)}
        self._send_addressed("COMMAND_LONG", command=command, confirmation=0, **fields)

    def _send_addressed(self, name: str, **fields: Any) -> None:
        self._send(name, target_system=self._system_id, target_component=1, **fields)

    def _send(self, name: str, **fields: Any) -> None:
        if self._direct is None:
            raise AutopilotError(f"autopilot {self._url}: not connected; {name} was not sent")
        text = json.dumps(fields, allow_nan=False)
        try:
            self._direct.send_message(MavlinkMessage(name, 0, 0, self._system_id, 1, text))
        except MavsdkError as error:
            raise AutopilotError(f"autopilot {self._url}: {name} was not sent: {error}") from error


def _hovers(state: VehicleState, least_height_m: float) -> bool:
    """Whether the climb has ended where it should. PX4 goes from TAKEOFF to HOLD by itself, at the height it was given:
    HOLD anywhere below is a person's or a failsafe's."""
    if state.mode not in (FlightMode.TAKEOFF, FlightMode.HOLD):
        raise GaveWayError(f"takeoff: the mode became {state.mode} meanwhile; somebody else decided")
    hovering = state.in_air and state.mode is FlightMode.HOLD
    if hovering and (state.p_local_enu_m is None or state.p_local_enu_m[2] < least_height_m):
        raise GaveWayError("takeoff: the climb was ended below its height; somebody else decided")
    return hovering


def _refuse_taken_port(url: str) -> None:
    """The library binds a UDP port that is already bound without complaint, and both then hear half."""
    parts = urlsplit(url)
    if parts.scheme not in ("udp", "udpin"):
        return
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((parts.hostname or "0.0.0.0", parts.port or 0))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise AutopilotError(f"autopilot {url}: the port is taken by another process") from None


@functools.cache  # once: the library may be calling the old callback while it is replaced
def _route_native_log() -> None:
    mavsdk.log_subscribe(_log_native)


def _log_native(level: int, message: str, file: str | None, line: int) -> bool:
    """The library's log lines go to logging; True keeps them off standard output."""
    levels = (logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR)
    _NATIVE_LOG.log(levels[level], "%s", message)
    return True
