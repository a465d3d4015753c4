"""The mock's commander at the edge's link: messages as fields, no bytes, no sockets; and what can go wrong between."""

from __future__ import annotations

import math
from typing import Any, Final

import msgspec

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S
from companion.core.messages import Setpoint
from companion.sim.px4.airframe import Airframe, AirframeLimits, Demand, Gusts
from companion.sim.px4.arming import CHECKS, prearm_health, report
from companion.sim.px4.commander import Commander, Mode, Result
from companion.sim.px4.parameters import field_and_kind, written
from tests.faults.missions.scenario import SWITCH_CHANNEL, Scenario
from tests.faults.missions.timeless import MissionClock

_PERIOD_NS: Final = {
    "HEARTBEAT": NS_PER_S, "EXTENDED_SYS_STATE": NS_PER_S // 5, "BATTERY_STATUS": NS_PER_S,
    "ESTIMATOR_STATUS": NS_PER_S // 2, "SYS_STATUS": NS_PER_S // 2, "TIMESYNC": NS_PER_S // 2,
    "RC_CHANNELS": NS_PER_S // 5, "CURRENT_MODE": 0, "LOCAL_POSITION_NED": 0, "ATTITUDE": NS_PER_S // 2,
}  # fmt: skip
"""0: each step, or when it changes. TIMESYNC, ATTITUDE and positions come slower than the edge asks for."""
_POSITION_TEXT: Final = (
    '{{"time_boot_ms": {}, "x": {!r}, "y": {!r}, "z": {!r}, "vx": {!r}, "vy": {!r}, "vz": {!r}}}'.format
)
_text: Final = msgspec.json.Encoder().encode
_HEARTBEATS: Final = frozenset({"HEARTBEAT"})
_POSITION: Final = frozenset({"LOCAL_POSITION_NED", "ATTITUDE"})
_UP_NS: Final = 9_400_000_000
_SET_MODE, _TAKEOFF, _ARM, _REQUEST, _CHECK = 176, 22, 400, 512, 401


class Vehicle:
    """One PX4 with its clock. `deliver` is called for each message that arrives."""

    def __init__(self, scenario: Scenario, clock: MissionClock) -> None:
        self.clock = clock
        self.step_ns = scenario.step_ns
        self.airframe = Airframe(AirframeLimits(), 0.0, Gusts(scenario.seed))
        parameters: dict[str, int | float] = {
            "COM_OBL_RC_ACT": scenario.rc_loss_act, "COM_RC_OVERRIDE": 3, "COM_DISARM_PRFLT": 30.0,
            "RTL_RETURN_ALT": 2.0, "NAV_MC_ALT_RAD": 0.3,
        }  # fmt: skip
        self.commander = Commander(self.airframe, clock.t_ns, parameters)
        self.batteries: dict[int, float | None] = {0: 0.9}
        self.up: bool | None = False
        self.wind_m_s2 = (0.0, 0.0)
        self.telemetry: Any = None
        self.mute = ""
        self.is_deaf = self.parameters_silent = False
        self.commands = self.offboard = ""
        self.silent_until_ns = 0
        self.checks: tuple[str, ...] = ()
        """What is wrong with its arming checks, as `Fault` has the words."""
        self.checks_passed_ns = -NS_PER_S << 20
        """When the program that runs was last told that they pass; long ago once it was told that they do not."""
        self._explains = any(fault.kind == "checks" for fault in scenario.faults)
        self._explained: object = None
        self._explain_ns = 0
        self._boot_ns = clock.t_ns - _UP_NS
        self._due_ns = dict.fromkeys(_PERIOD_NS, 0)
        if scenario.config.autopilot is None or scenario.config.autopilot.engage_rc_channel is None:
            del self._due_ns["RC_CHANNELS"]  # nobody listens to it
        self._mode_told: Any = None
        if scenario.starts_in_air:
            self._hover(scenario.config.mission.takeoff_height_m)

    @property
    def now_ns(self) -> int:
        """This vehicle's view of our time: its own goes on while our host is suspended."""
        return self.clock.boot_ns()

    def _hover(self, height_m: float) -> None:
        self.airframe.p_enu_m = (0.0, 0.0, height_m)
        self.commander.arm(self.now_ns)
        self.commander.landed = False
        self.commander.pilot_mode(Mode.HOLD)
        self.commander._target = self.commander._hover()

    def step(self) -> None:
        """One step, up to the clock's time."""
        if any(self.wind_m_s2) and not self.airframe.on_ground:
            x, y, z = self.airframe.v_enu_m_s
            dx, dy = (a * self.step_ns / NS_PER_S for a in self.wind_m_s2)
            self.airframe.v_enu_m_s = (x + dx, y + dy, z)
        self.commander.refuse_offboard = self.offboard == "refuse"
        self.commander.step(self.now_ns)

    def reboot(self, silent_s: float) -> None:
        self.commander.boot(self.now_ns)
        self._boot_ns = self.now_ns
        self.silent_until_ns = self.now_ns + round(silent_s * NS_PER_S)

    def tell(self) -> None:
        """Sends what is due."""
        now_ns, commander = self.now_ns, self.commander
        mode = (commander.mode, commander.intention, commander.armed, commander.failsafe)
        for name, due_ns in self._due_ns.items():
            if now_ns < due_ns or (name == "CURRENT_MODE" and mode == self._mode_told):
                continue
            self._due_ns[name] = max(due_ns + _PERIOD_NS[name], now_ns - _PERIOD_NS[name])
            self._say(name)
        self._mode_told = mode
        if self._explains and now_ns >= self._explain_ns and self._explained != self._found:
            self._explain()

    @property
    def _found(self) -> object:
        return self.commander.failing_checks, self.commander.can_arm

    def _explain(self) -> None:
        """PX4's report of its arming checks: when it changes, 2 s after the last at the soonest, or when asked."""
        self._explained, self._explain_ns = self._found, self.now_ns + 2 * NS_PER_S
        if "unexplained" in self.checks or self.is_muted("EVENT"):
            return
        for number, levels, arguments in report(self.commander):
            self.message("EVENT", {"id": number, "log_levels": levels, "arguments": list(arguments.ljust(40, b"\0"))})

    def let_fail(self, words: tuple[str, ...]) -> None:
        self.checks = words
        failing = tuple(word for word in words if word in CHECKS)
        self.commander.failing_checks = failing or (("usb_connected",) if "unexplained" in words else ())

    def _say(self, name: str) -> None:
        if self.is_muted(name) or (name == "LOCAL_POSITION_NED" and not self.commander.estimator.has_local_position):
            return
        if name == "SYS_STATUS":
            self._say_status()
        elif name == "BATTERY_STATUS":
            for number, charge in self.batteries.items():
                self.message(name, {"id": number, "battery_remaining": -1 if charge is None else round(100 * charge)})
        elif name == "LOCAL_POSITION_NED" and self.telemetry is not None:
            (x, y, z), (vx, vy, vz) = self.airframe.estimated_p_enu_m, self.airframe.v_enu_m_s
            self.telemetry.take(name, 1, _POSITION_TEXT(self._boot_ms(), y, x, -z, vy, vx, -vz))
        else:
            self.message(name, self._fields(name))

    def _say_status(self) -> None:
        if "untold" in self.checks:
            return
        masks = {"present": 0, "enabled": 0, "health": prearm_health(self.commander)}
        self.message("SYS_STATUS", {f"onboard_control_sensors_{part}": mask for part, mask in masks.items()})
        if self.telemetry is not None:
            self.checks_passed_ns = self.clock.t_ns if masks["health"] else -NS_PER_S << 20

    def is_muted(self, name: str) -> bool:
        match self.mute:
            case "everything":
                return True
            case "heartbeats":
                return name in _HEARTBEATS
            case "telemetry":
                return name not in _HEARTBEATS
            case "position":
                return name in _POSITION
        return self.now_ns < self.silent_until_ns

    def message(self, name: str, fields: dict[str, Any]) -> None:
        if self.telemetry is not None:
            self.telemetry.take(name, 1, _text(fields).decode())

    def _boot_ms(self) -> int:
        return (self.now_ns - self._boot_ns) // 1_000_000

    def _fields(self, name: str) -> dict[str, Any]:
        commander = self.commander
        match name:
            case "HEARTBEAT":
                return {
                    "custom_mode": commander.mode.custom_mode, "base_mode": 1 | (128 if commander.armed else 0),
                    "system_status": 5 if commander.failsafe else 4, "autopilot": 12, "type": 2,
                }  # fmt: skip
            case "CURRENT_MODE":
                custom = commander.mode.custom_mode
                return {"custom_mode": custom, "intended_custom_mode": commander.intention.custom_mode}
            case "ATTITUDE":
                yaw_rad = math.remainder(math.pi / 2 - self.airframe.yaw_enu_rad, math.tau)
                return {"time_boot_ms": self._boot_ms(), "yaw": yaw_rad}
            case "AUTOPILOT_VERSION":
                return {"flight_sw_version": 1 << 24 | 16 << 16 | 1 << 8}
            case "EXTENDED_SYS_STATE":
                return {"landed_state": 1 if commander.landed else 2}
            case "ESTIMATOR_STATUS":
                return {"flags": commander.estimator.flags(commander.is_at_rest)}
            case "TIMESYNC":
                return {"tc1": 0, "ts1": self.now_ns - self._boot_ns}
        channels = [1500] * 8
        channels[SWITCH_CHANNEL - 1] = 2000 if self.up else 1000
        count = 0 if self.up is None else 8
        return {"chancount": count, **{f"chan{i}_raw": us for i, us in enumerate(channels, 1)}}

    def command(self, number: int, values: list[float | None]) -> None:
        """COMMAND_LONG arrived."""
        if number == _SET_MODE and not (self.commands == "silent" or self._refuses_silently(values)):
            self.acknowledge(number, Result.ACCEPTED)  # the MAVLink module at once, the commander later
            wanted = (int(values[1] or 0), int(values[2] or 0))
            mode = next(mode for mode in Mode if mode.value == wanted)
            refused = self.commands == "refuse"
            self.acknowledge(number, Result.DENIED if refused else self.commander.command_mode(mode, self.now_ns))
        elif number in (_ARM, _TAKEOFF) and not self.commands:
            self.acknowledge(number, self._take(number, bool(values[0])))
        elif number in (_ARM, _TAKEOFF) and self.commands == "refuse":
            self.acknowledge(number, Result.TEMPORARILY_REJECTED)
        elif number == _REQUEST:
            self._say("AUTOPILOT_VERSION" if values[0] else "HEARTBEAT")
        elif number == _CHECK and self._explains:
            self._explain()
        elif number not in (_SET_MODE, _ARM, _TAKEOFF):
            self.acknowledge(number, Result.ACCEPTED)

    def _take(self, number: int, arms: bool) -> Result:
        if number == _TAKEOFF:
            return self.commander.command_takeoff(self.now_ns)
        return self.commander.arm(self.now_ns) if arms else self.commander.disarm()

    def _refuses_silently(self, values: list[float | None]) -> bool:
        return self.offboard == "silent" and values[1] == Mode.OFFBOARD.value[0]

    def acknowledge(self, number: int, result: Result) -> None:
        if not self.is_muted("COMMAND_ACK"):
            self.message("COMMAND_ACK", {"command": number, "result": int(result)})

    def parameter(self, name: str, written_value: tuple[float, int] | None = None) -> None:
        """PARAM_SET or PARAM_REQUEST_READ arrived."""
        parameters = self.commander.parameters
        if self.parameters_silent or self.is_muted("PARAM_VALUE"):
            return
        if written_value is not None:
            value = written(parameters[name], *written_value)
            if value is None:
                return
            parameters[name] = value
        field, kind = field_and_kind(parameters[name])
        shown = field if math.isfinite(field) else None
        self.message("PARAM_VALUE", {"param_id": name, "param_value": shown, "param_type": kind})


class VehicleLink:
    """Stands in for the edge's `MavsdkLink`; one service's end of it. `sent` hears all that leaves."""

    url, system_id = "virtual", 1

    def __init__(self, vehicle: Vehicle, sent: Any) -> None:
        self._vehicle = vehicle
        self._sent = sent
        self.is_open = False
        self.is_closed = False
        """The library refuses to send."""
        self.is_killed = False

    async def open(self, timeout_s: float) -> None:
        if self.is_closed or self.is_killed:
            raise AutopilotError("the link cannot be opened")
        self.is_open = True

    async def aclose(self) -> None:
        self.is_open = False

    def others(self) -> set[str]:
        return set()

    def send_addressed(self, name: str, **fields: Any) -> None:
        self.send(name, **fields)

    def send(self, name: str, **fields: Any) -> None:
        if self.is_killed or self.is_closed or not self.is_open:
            raise AutopilotError(f"not connected; {name} was not sent")
        vehicle = self._vehicle
        self._sent(name, fields)
        if vehicle.is_deaf or vehicle.mute == "everything" or vehicle.now_ns < vehicle.silent_until_ns:
            return
        if name == "SET_POSITION_TARGET_LOCAL_NED":
            vehicle.commander.set_point(demand(fields), vehicle.now_ns)
        elif name == "COMMAND_LONG":
            vehicle.command(fields["command"], [fields[f"param{i}"] for i in range(1, 8)])
        elif name == "PARAM_REQUEST_READ":
            vehicle.parameter(fields["param_id"])
        elif name == "PARAM_SET":
            vehicle.parameter(fields["param_id"], (fields["param_value"], fields["param_type"]))


def demand(fields: dict[str, Any]) -> Demand:
    s = setpoint(fields, 0)
    place = (None, None, None) if s.p_local_enu_m is None else s.p_local_enu_m
    return Demand(place, s.v_local_enu_m_s, s.yaw_enu_rad)


def setpoint(fields: dict[str, Any], now_ns: int) -> Setpoint:
    """What SET_POSITION_TARGET_LOCAL_NED asks for, read anew from its fields."""
    mask = fields["type_mask"]
    place = None if mask & 7 else (fields["y"], fields["x"], -fields["z"])
    yaw = None if mask & 1024 else math.remainder(math.pi / 2 - fields["yaw"], math.tau)
    return Setpoint(now_ns, place, (fields["vy"], fields["vx"], -fields["vz"]), yaw)


def edge_on(vehicle: Vehicle, link: VehicleLink) -> MavsdkAutopilot:
    """The real edge at a link of ours. From now on it is the one that hears the vehicle."""
    edge = MavsdkAutopilot(link.url, vehicle.clock, system_id=link.system_id)
    edge._link = link  # type: ignore[assignment]
    vehicle.telemetry = edge._telemetry
    vehicle.checks_passed_ns = -NS_PER_S << 20
    return edge
