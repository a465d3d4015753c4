"""The mock's MAVLink side: bytes in, bytes out. No socket; time is a number."""

from __future__ import annotations

import math
import struct
import time
from collections import deque
from typing import Any, Literal

from pymavlink.dialects.v20 import development as mavlink

from companion.core.clock import NS_PER_S
from companion.sim.px4.airframe import Demand
from companion.sim.px4.arming import ArmingReports
from companion.sim.px4.clocks import ClockFilter, PowerUpClock
from companion.sim.px4.commander import Commander, Mode, Result, finite_or_none
from companion.sim.px4.estimator import Vision
from companion.sim.px4.parameters import field_and_kind, written
from companion.sim.px4.streams import Streams

Mute = Literal["nothing", "heartbeats", "everything"]
_HANDED_ON = 500
"""Of what nobody takes no more is kept."""
_TIMESYNC = struct.Struct("<qqBB")
_MODE_COMMANDS = {mavlink.MAV_CMD_NAV_LAND: Mode.LAND, mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: Mode.RTL}


class Px4Link:
    """Speaks as component 1 (the autopilot) of one system to one companion.

    `mute`, `ignore_mode_commands` and `ignore_parameter_requests` are faults to inject.
    """

    def __init__(
        self,
        *,
        commander: Commander,
        now_ns: int,
        clock: PowerUpClock | None = None,
        system_id: int = 1,
        kind: int = mavlink.MAV_AUTOPILOT_PX4,
        signing_key: bytes | None = None,
    ) -> None:
        """With a `signing_key` it signs all it sends and takes nothing that is not signed with it."""
        self.commander = commander
        self.clock = clock or PowerUpClock(now_ns)
        self.mute: Mute = "nothing"
        self.ignore_mode_commands = False
        self.ignore_parameter_requests = False
        self.received: dict[str, int] = {}
        """How much came of each message, and of each command under its number."""
        self.peer_heartbeats = 0
        self.timesync_answers = 0
        self.companion_clock = ClockFilter()
        self.onboard_statuses = 0
        self.vision: Any = None
        """The newest pose that the companion sent for the estimator."""
        self.visions = 0
        self.vision_age_s: float | None = None
        self._system_id = system_id
        self._now_ns = now_ns
        self._off_until_ns = now_ns
        self._out: list[bytes] = []
        self._handed_on: deque[bytes] = deque(maxlen=_HANDED_ON)
        self._mav = mavlink.MAVLink(self, srcSystem=system_id, srcComponent=1)
        self.refused = 0
        """Frames without the signature that is demanded."""
        if signing_key is not None:
            self._mav.signing.secret_key = signing_key
            self._mav.signing.sign_outgoing = True
            self._mav.signing.timestamp = round((time.time() - 1_420_070_400) * 1e5)
        self.streams = Streams(commander=commander, clock=self.clock, mav=self._mav, kind=kind, now_ns=now_ns)
        self._arming = ArmingReports(commander, self.clock, self._mav)

    def write(self, frame: bytes) -> None:
        """Called by pymavlink with each packed frame."""
        self._out.append(bytes(frame))

    def receive(self, datagram: bytes, now_ns: int) -> list[bytes]:
        """Handle what arrived; the replies to send at once. Bytes that are no MAVLink are ignored, and so is what is
        addressed to another system."""
        self._now_ns = now_ns
        if now_ns < self._off_until_ns:
            return []
        parser = mavlink.MAVLink(None)  # a datagram holds whole frames: what is left of one belongs to no other
        parser.robust_parsing = True
        parser.signing = self._mav.signing
        for message in parser.parse_buffer(datagram) or ():
            if message.get_type() == "BAD_DATA":
                self.refused += 1
                continue
            if self._is_for_others(message):
                self._handed_on.append(bytes(message.get_msgbuf()))
            # PX4 reads TIMESYNC without looking at whom it is addressed to.
            if message.get_type() != "TIMESYNC" and getattr(message, "target_system", 0) not in (0, self._system_id):
                continue
            self._count(message)
            handler = getattr(self, f"_on_{message.get_type().lower()}", None)
            if handler is not None:
                handler(message)
        return self._take()

    def take_handed_on(self) -> list[bytes]:
        """What the other links of the vehicle get of what has come in since the last call (MAV_n_FORWARD): all that is
        not for the autopilot alone."""
        handed_on = list(self._handed_on)
        self._handed_on.clear()
        return handed_on

    def _is_for_others(self, message: Any) -> bool:
        system, component = getattr(message, "target_system", 0), getattr(message, "target_component", 0)
        return (system, component) != (self._system_id, 1) and message.get_type() != "RADIO_STATUS"

    def telemetry(self, now_ns: int) -> list[bytes]:
        """The stream messages that are due."""
        self._now_ns = now_ns
        if now_ns < self._off_until_ns:
            return []
        for text in self.commander.said:
            self.say(text)
        self.commander.said.clear()
        self.streams.has_heartbeats = self.mute != "heartbeats"
        self.streams.send_due(now_ns)
        self._arming.send_due(now_ns)
        return self._take()

    def say(self, text: str) -> None:
        """STATUSTEXT of severity warning with the next telemetry."""
        self._mav.send(self._mav.statustext_encode(mavlink.MAV_SEVERITY_WARNING, text.encode()[:50]))

    def reboot(self, now_ns: int, silent_s: float) -> None:
        """Power-up anew after `silent_s`: the clock starts at nothing, and what was asked for is forgotten."""
        self._off_until_ns = now_ns + round(silent_s * NS_PER_S)
        self.clock.boot(self._off_until_ns)
        self.companion_clock = ClockFilter()
        self.commander.boot(now_ns)
        self.streams.boot(self._off_until_ns)
        self._arming.boot()

    def vanish(self) -> None:
        """Never heard again."""
        self._off_until_ns = 1 << 62

    def _count(self, message: Any) -> None:
        name = message.get_type()
        name += f" {message.command}" if name.startswith("COMMAND_") else ""
        self.received[name] = self.received.get(name, 0) + 1

    def _take(self) -> list[bytes]:
        out, self._out = self._out, []
        return [] if self.mute == "everything" else out

    # What the companion sends.

    def _on_heartbeat(self, message: Any) -> None:
        self.peer_heartbeats += 1

    def _on_timesync(self, message: Any) -> None:
        own_ns = self.clock.ns(self._now_ns)
        if message.tc1 == 0:
            self._answer_timesync(own_ns, message.ts1)
        else:
            self.timesync_answers += 1
            self.companion_clock.answer(own_ns, message.tc1, message.ts1)  # ts1 is our own time when we asked

    def _answer_timesync(self, own_ns: int, ts1: int) -> None:
        """PX4 1.16 leaves the target of this one unset, so that it seems addressed to whatever its stack held."""
        message = self._mav.timesync_encode(own_ns, ts1)
        self.write(message._pack(self._mav, message.crc_extra, _TIMESYNC.pack(own_ns, ts1, 160, 234)))
        self._mav.seq = (self._mav.seq + 1) % 256

    def _on_set_gps_global_origin(self, message: Any) -> None:
        self.commander.estimator.set_origin(message.altitude / 1000)
        self._mav.send(self._mav.gps_global_origin_encode(message.latitude, message.longitude, message.altitude))

    def _on_onboard_computer_status(self, message: Any) -> None:
        self.onboard_statuses += 1

    def _on_odometry(self, message: Any) -> None:
        """PX4 takes vision in LOCAL_FRD or LOCAL_NED with BODY_FRD and drops every other frame without a word."""
        frames = (mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_LOCAL_NED)
        if message.frame_id not in frames or message.child_frame_id != mavlink.MAV_FRAME_BODY_FRD:
            return
        self.vision, self.visions = message, self.visions + 1
        own_ns, stamp_ns = self.clock.ns(self._now_ns), message.time_usec * 1000
        if self.companion_clock.samples:
            self.vision_age_s = (own_ns - stamp_ns - self.companion_clock.offset_ns) / NS_PER_S
        age_ns = own_ns - self.companion_clock.own_time_ns(own_ns, stamp_ns)
        place = (message.y, message.x, -message.z)
        if all(map(math.isfinite, place)):
            is_north_aligned = message.frame_id == mavlink.MAV_FRAME_LOCAL_NED
            vision = Vision(self._now_ns - age_ns, place, message.reset_counter, is_north_aligned)
            self.commander.estimator.vision(vision)

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
            return commander.command_takeoff(self._now_ns)
        if command in _MODE_COMMANDS:
            return commander.command_mode(_MODE_COMMANDS[command], self._now_ns)
        if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return self._set_interval(int(message.param1), message.param2)
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            return self._request_message(int(message.param1))
        if command == mavlink.MAV_CMD_RUN_PREARM_CHECKS:
            self._arming.send(self._now_ns)
            return Result.ACCEPTED
        if command == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return self._request_message(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
        return Result.UNSUPPORTED

    def _set_interval(self, message_id: int, interval_us: float) -> Result:
        done = self.streams.set_interval(message_id, interval_us, self._now_ns)
        return Result.ACCEPTED if done else Result.FAILED

    def _request_message(self, message_id: int) -> Result:
        done = self.streams.send_requested(message_id, self._now_ns)
        return Result.UNSUPPORTED if done is None else Result.ACCEPTED if done else Result.FAILED

    def _acknowledge(self, command: int, result: Result, sender: tuple[int, int]) -> None:
        self._mav.send(self._mav.command_ack_encode(command, int(result), 0, 0, *sender))

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
        name, parameters = message.param_id, self.commander.parameters
        value = written(parameters[name], message.param_value, message.param_type) if name in parameters else None
        if value is not None:
            parameters[name] = value
            self._send_parameter(name)

    def _send_parameter(self, name: str) -> None:
        names = list(self.commander.parameters)
        field, kind = field_and_kind(self.commander.parameters[name])
        self._mav.send(self._mav.param_value_encode(name.encode(), field, kind, len(names), names.index(name)))


def _demand(message: Any) -> Demand:
    mask = int(message.type_mask)
    px, py, pz = (bool(mask & bit) for bit in (1, 2, 4))
    vx, vy, vz = (bool(mask & bit) for bit in (8, 16, 32))
    north, east, down = finite_or_none((message.x, message.y, message.z), (px, py, pz))
    v_north, v_east, v_down = finite_or_none((message.vx, message.vy, message.vz), (vx, vy, vz))
    yaw = None if mask & 1024 or not math.isfinite(message.yaw) else math.pi / 2 - message.yaw
    p_enu_m = (east, north, None if down is None else -down)
    return Demand(p_enu_m, (v_east or 0.0, v_north or 0.0, -(v_down or 0.0)), yaw)
