"""The autopilot port on MAVSDK 4.1.

One call of `send_setpoint` is one SET_POSITION_TARGET_LOCAL_NED: the library's Offboard plugin, which repeats the last
set point for ever by itself, is never used.

Commands are COMMAND_LONG messages, repeated by the waiting caller and not by the library: a command must not be sent
again after its caller gave up. NED exists from here outwards only.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Callable, Iterable
from typing import Final

from companion.autopilot import onboard_status, px4_modes, rates
from companion.autopilot.climb import Climb, HeightRead
from companion.autopilot.ground_station import GroundStation
from companion.autopilot.mavsdk_link import MavsdkLink
from companion.autopilot.odometry import odometry_fields
from companion.autopilot.port import AutopilotError, GaveWayError
from companion.autopilot.reconnect import Backoff
from companion.autopilot.setpoint import setpoint_fields
from companion.autopilot.telemetry import Telemetry, parameter_field
from companion.core.clock import NS_PER_S, Clock, age_s, next_beat_ns
from companion.core.messages import AutopilotEvent, FlightMode, Pose, Setpoint, VehicleState

_LOG = logging.getLogger(__name__)

_CONFIRM_TIMEOUT_S = 2.9  # so that all of it, from the request to the abort, takes 3 s at most
_REPEAT_S = 0.5
_POLL_S = 0.01
_STALLED_S = 0.5
_CLIMB_S_PER_M = 4.0
"""PX4 may be set to climb as slowly as this in takeoff."""
_WATCH_NS = NS_PER_S // 10
_HEARTBEAT_LATE_S = 1.1
"""Heartbeats come at 1 Hz. One that is late is asked for, so that a single lost one is no lost link."""
_RECONNECT_S = 5.0
_STATUS_S = 1.0

_CMD_NAV_TAKEOFF: Final = 22
_CMD_DO_SET_MODE: Final = 176
_CMD_ARM_DISARM: Final = 400
_CMD_RUN_PREARM_CHECKS: Final = 401
_CMD_SET_MESSAGE_INTERVAL: Final = 511
_CMD_REQUEST_MESSAGE: Final = 512
_HEARTBEAT: Final = 0
_AUTOPILOT_VERSION: Final = 148
_MODE_FLAG_CUSTOM: Final = 1
_PARAMETER_INT32: Final = 6
_PARAMETER_REAL32: Final = 9
_ANSWERS: Final = {_CMD_DO_SET_MODE: 2}
"""To one request: the MAVLink module accepts a mode at once, and the commander answers when it has decided."""
_ACCEPTED: Final = 0
_RESULTS: Final = ("accepted", "temporarily rejected", "denied", "unsupported", "failed", "in progress", "cancelled")


class MavsdkAutopilot:
    """An `Autopilot` behind a MAVSDK connection such as udpin://127.0.0.1:14540 or serial:///dev/ttyS1:921600."""

    def __init__(
        self,
        url: str,
        clock: Clock,
        on_odometry: Callable[[Pose], None] | None = None,
        system_id: int | None = None,
        is_of_vehicle: bool = False,
        wants_gps: bool = False,
    ) -> None:
        """`on_odometry` gets the autopilot's own odometry as poses, on the library's thread. Without a `system_id` the
        first PX4 that is heard is ours, and no other ever after. `is_of_vehicle`: as in `MavsdkLink`."""
        self._clock = clock
        self._telemetry = Telemetry(clock.now_ns, on_odometry, self._answer_time, wants_gps)
        self._link = MavsdkLink(
            url=url,
            names=self._telemetry.message_names,
            on_message=self._telemetry.take,
            system_id=system_id,
            is_of_vehicle=is_of_vehicle,
        )
        self.ground = GroundStation(self._link, self._vehicle_ms)
        self._asked_ns = 0
        self._asked_boots = 0
        self._asked_armed = False
        self._others: set[str] = set()
        odometry = {} if on_odometry is None else rates.ODOMETRY_US
        self._intervals_us = rates.ALWAYS_US | odometry | (rates.GPS_US if wants_gps else {})
        self._problem = "not connected yet"

    @property
    def problem(self) -> str:
        """Why there is no connection; empty while there is one."""
        return self._problem

    @property
    def is_armed(self) -> bool:
        """As `state` tells, for whoever asks at each datagram."""
        return bool(self._telemetry.told("armed"))

    async def connect(self, timeout_s: float = 10.0) -> None:
        """Raises AutopilotError when the port is taken, or our vehicle is not heard within `timeout_s` or is no PX4."""
        opened_ns = self._clock.now_ns()
        await self._link.open(timeout_s)
        assert self._link.system_id is not None
        self._telemetry.identify(self._link.system_id)
        try:
            self._ask_for_telemetry()
            await self._until(lambda s: (s.heartbeat_mono_ns or 0) > opened_ns, timeout_s, "the first heartbeat")
        except AutopilotError:
            await self.aclose()
            raise
        self._problem = ""

    async def run(self) -> None:
        backoff = Backoff()
        while True:
            try:
                await self.connect(timeout_s=_RECONNECT_S)
            except AutopilotError as error:
                self._problem = str(error)
                _LOG.log(backoff.level, "%s; trying again", error)
                await self._sleep(backoff.next_s())
                continue
            _LOG.info(
                "autopilot %s: connected to system %d, and to no other from now on",
                self._link.url,
                self._link.system_id,
            )
            backoff = Backoff()
            await self.watch()
            self._problem = f"autopilot {self._link.url}: its heartbeats stopped"
            _LOG.warning("%s; connecting anew", self._problem)
            await self.aclose()

    async def aclose(self) -> None:
        await self._link.aclose()

    def state(self) -> VehicleState:
        return self._telemetry.state()

    def send_setpoint(self, setpoint: Setpoint) -> None:
        """Raises AutopilotError when the set point is not finite or the link is closed."""
        if not setpoint.is_finite():
            raise AutopilotError(f"set point {setpoint}: not finite; nothing was sent")
        self._link.send_addressed("SET_POSITION_TARGET_LOCAL_NED", **setpoint_fields(setpoint))

    def send_odometry(self, pose: Pose, reset_counter: int) -> None:
        """Raises AutopilotError while the vehicle's own time is not known, in which poses are stamped."""
        vehicle_ns = self._telemetry.vehicle_ns(pose.t_mono_ns)
        if vehicle_ns is None or vehicle_ns < 0:
            raise AutopilotError(f"autopilot {self._link.url}: its own time is not known yet; ODOMETRY was not sent")
        self._link.send("ODOMETRY", **odometry_fields(pose, reset_counter, vehicle_ns))

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> None:
        """Where the local frame of a vehicle without GPS lies: without that PX4 has no global position and cannot hold.

        Its altitude is always 0: PX4 1.16 moves the estimate down by it when a `reset_counter` rises.
        """
        self._link.send(
            "SET_GPS_GLOBAL_ORIGIN",
            target_system=self._link.system_id,
            latitude=round(1e7 * latitude_deg),
            longitude=round(1e7 * longitude_deg),
            altitude=0,
            time_usec=0,
        )

    def _answer_time(self, ts1: int) -> None:
        """PX4 asks for our time, on the library's thread: it gets its own, as we know it, since poses carry that."""
        vehicle_ns = self._telemetry.vehicle_ns(self._clock.now_ns())
        if vehicle_ns is not None:
            with contextlib.suppress(AutopilotError):  # PX4 asks again
                self._link.send_addressed("TIMESYNC", tc1=vehicle_ns, ts1=ts1)

    def _vehicle_ms(self) -> int:
        """The vehicle's own time, or nothing."""
        return max(0, self._telemetry.vehicle_ns(self._clock.now_ns()) or 0) // 1_000_000 & 0xFFFFFFFF

    def take_events(self) -> list[AutopilotEvent]:
        return self._telemetry.take_events()

    async def arm(self) -> None:
        await self._command(_CMD_ARM_DISARM, (1,), lambda state: state.armed, "arming")

    async def takeoff(self, height_m: float) -> None:
        if self.state().in_air:
            return
        ground_m = self._height_m()
        if abs(await self.parameter("MIS_TAKEOFF_ALT") - height_m) > 1e-3:
            await self.set_parameter("MIS_TAKEOFF_ALT", height_m)
            await self._until(HeightRead(self.state()).is_over, 2 * _CONFIRM_TIMEOUT_S, "takeoff: its height")
        climb = Climb(ground_m, height_m, float(await self.parameter("NAV_MC_ALT_RAD")))
        # NaN (null) leaves yaw, place and altitude to PX4, which then climbs to MIS_TAKEOFF_ALT.
        await self._command(
            _CMD_NAV_TAKEOFF,
            (0, 0, 0, None, None, None, None),
            lambda state: state.mode is FlightMode.TAKEOFF or state.in_air,
            "takeoff",
        )
        await self._until(climb.hovers, 10 + _CLIMB_S_PER_M * height_m, f"takeoff: hovering at {height_m:g} m")

    async def request_offboard(self) -> None:
        """Raises AutopilotError after 3 s, or as soon as the mode changes to anything else: somebody took over."""
        await self._set_mode(px4_modes.OFFBOARD, FlightMode.OFFBOARD)

    async def hold(self) -> None:
        await self._set_mode(px4_modes.HOLD, FlightMode.HOLD)

    async def land(self) -> None:
        await self._leave_offboard()
        await self._set_mode(px4_modes.LAND, FlightMode.LAND)

    async def return_home(self) -> None:
        await self._leave_offboard()
        await self._set_mode(px4_modes.RETURN, FlightMode.RETURN)

    async def _leave_offboard(self) -> None:
        """PX4 goes back to OFFBOARD after a landing that began there, so hold is asked for on the way."""
        if self.state().mode is FlightMode.OFFBOARD:
            try:
                await self._set_mode(px4_modes.HOLD, FlightMode.HOLD, timeout_s=_REPEAT_S)
            except GaveWayError:
                raise
            except AutopilotError:
                pass  # hold needs a position, landing does not

    async def parameter(self, name: str) -> int | float:
        self._telemetry.parameters.pop(name, None)
        request = {"param_id": name, "param_index": -1}
        await self._repeat(
            lambda: self._link.send_addressed("PARAM_REQUEST_READ", **request),
            lambda: name in self._telemetry.parameters,
            _CONFIRM_TIMEOUT_S,
            lambda: f"parameter {name}: no answer; the autopilot may not have it",
        )
        value = self._telemetry.parameters[name]
        if value is None:
            raise AutopilotError(f"parameter {name}: its value cannot be read over this library (it is not a number)")
        return value

    async def set_parameter(self, name: str, value: int | float) -> None:
        """An int is written as PX4's INT32, a float as its REAL32. Raises AutopilotError when it did not take it."""
        self._telemetry.parameters.pop(name, None)
        kind = _PARAMETER_INT32 if isinstance(value, int) else _PARAMETER_REAL32
        fields = {"param_id": name, "param_value": parameter_field(value), "param_type": kind}
        await self._repeat(
            lambda: self._link.send_addressed("PARAM_SET", **fields),
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

        await self._command(
            _CMD_DO_SET_MODE, (_MODE_FLAG_CUSTOM, *custom), confirmed, f"mode {wanted}", timeout_s=timeout_s
        )

    async def _command(
        self,
        command: int,
        parameters: tuple[float | None, ...],
        confirmed: Callable[[VehicleState], bool],
        what: str,
        *,
        timeout_s: float = _CONFIRM_TIMEOUT_S,
    ) -> None:
        self._telemetry.acknowledgements.pop(command, None)

        def reason() -> str:
            result = self._telemetry.acknowledgements.get(command)
            answer = "nothing" if result is None else f"{_RESULTS[result] if result < len(_RESULTS) else result}"
            return f"{what}: not confirmed by telemetry; mode is {self.state().mode}, its last answer was {answer}"

        await self._repeat(self._asker(command, parameters), lambda: confirmed(self.state()), timeout_s, reason)

    def _asker(self, command: int, parameters: tuple[float | None, ...]) -> Callable[[], None]:
        """Sends the command, but not again once all of its answers have come and grant it: what was granted and is not
        seen then was ended by somebody else within a moment, and must not be taken back. Nor is a mode asked for again
        before the vehicle has told that it still flies another: what was not heard may have been granted as well."""
        before, sent, sent_ns = self._telemetry.acknowledged[command], 0, 0

        def ask() -> None:
            nonlocal sent, sent_ns
            answers = self._telemetry.acknowledged[command] - before
            is_answered = sent > 0 and answers >= sent * _ANSWERS.get(command, 1)
            is_granted = is_answered and self._telemetry.acknowledgements.get(command) == _ACCEPTED
            is_deaf = sent > 0 and (self._telemetry.told("mode_mono_ns") or 0) <= sent_ns
            if is_granted or (is_deaf and command == _CMD_DO_SET_MODE):
                return
            sent, sent_ns = sent + 1, self._clock.now_ns()
            self._send_command(command, parameters)

        return ask

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

    async def watch(self) -> None:
        """Until heartbeats have stayed away for long: asks for what stays away, and tells the autopilot how we are."""
        status_ns = 0
        while self._heartbeat_age_s() < _RECONNECT_S:
            await self._clock.sleep_until_ns(next_beat_ns(self._clock.now_ns(), _WATCH_NS))
            with contextlib.suppress(AutopilotError):  # what was not sent shows as a heartbeat that stays away
                self._ask_again()
                if self._clock.now_ns() - status_ns >= _STATUS_S * NS_PER_S:
                    status_ns = self._clock.now_ns()
                    self._warn_of_others()
                    self._link.send("ONBOARD_COMPUTER_STATUS", **onboard_status.fields())

    def _warn_of_others(self) -> None:
        """Another vehicle on the link is left alone, and said once."""
        for name in self._link.others() - self._others:
            self._others.add(name)
            _LOG.warning("autopilot %s: %s is on the link too and is left alone", self._link.url, name)

    def _ask_again(self) -> None:
        """A late heartbeat, and all that a restarted vehicle has forgotten or that was lost on the way."""
        now_ns, boots = self._clock.now_ns(), self._telemetry.told("boots") or 0
        if self._heartbeat_age_s() > _HEARTBEAT_LATE_S:
            self._send_command(_CMD_REQUEST_MESSAGE, (_HEARTBEAT,))
        unanswered = self._telemetry.acknowledged[_CMD_SET_MESSAGE_INTERVAL] < len(self._intervals_us)
        due = now_ns - self._asked_ns > _STATUS_S * NS_PER_S
        if boots != self._asked_boots or (due and unanswered):
            self._ask_for_telemetry()
        elif self._asked_armed != bool(self._telemetry.told("armed")):
            self._ask_for_intervals(rates.DISARMED_US)
        elif due and not self._telemetry.told("firmware"):
            self._asked_ns = now_ns
            self._send_command(_CMD_REQUEST_MESSAGE, (_AUTOPILOT_VERSION,))
        elif due and self._telemetry.fails_silently():  # before we listened; asked, it says why again
            self._asked_ns = now_ns
            self._send_command(_CMD_RUN_PREARM_CHECKS, ())

    def _heartbeat_age_s(self) -> float:
        return age_s(self._telemetry.told("heartbeat_mono_ns"), self._clock.now_ns())

    async def _sleep(self, seconds: float) -> None:
        await self._clock.sleep_until_ns(self._clock.now_ns() + round(seconds * NS_PER_S))

    def _ask_for_telemetry(self) -> None:
        self._asked_boots = self.state().boots
        self._ask_for_intervals(self._intervals_us)
        for message_id in (_HEARTBEAT, _AUTOPILOT_VERSION):
            self._send_command(_CMD_REQUEST_MESSAGE, (message_id,))

    def _ask_for_intervals(self, message_ids: Iterable[int]) -> None:
        self._asked_ns, self._asked_armed = self._clock.now_ns(), self.state().armed
        wanted_us = self._intervals_us | ({} if self._asked_armed else rates.DISARMED_US)
        asked = [(message_id, wanted_us[message_id]) for message_id in message_ids]
        self._telemetry.acknowledged[_CMD_SET_MESSAGE_INTERVAL] = len(wanted_us) - len(asked)
        for one in asked:
            self._send_command(_CMD_SET_MESSAGE_INTERVAL, one)

    def _send_command(self, command: int, parameters: tuple[float | None, ...]) -> None:
        padded = (*parameters, *(0,) * (7 - len(parameters)))
        fields = {f"param{i}": value for i, value in enumerate(padded, 1)}
        self._link.send_addressed("COMMAND_LONG", command=command, confirmation=0, **fields)
