"""A mock PX4 on loopback UDP: `python -m companion.sim.px4.autopilot --connect 127.0.0.1:14540`.

Like PX4's onboard link it sends to the companion's listening port and takes what comes back. With `--truth` it reports
the true state to the world simulator, with `--control` it takes orders from a test, one text datagram each, and
answers with a `Px4Report`:

    report | pilot MODE | sticks EAST NORTH UP | mute nothing/heartbeats/everything | offboard accept/refuse/silent
    battery [ID] FRACTION/unknown/silent | parameter NAME VALUE | parameters heard/silent | rc MICROSECONDS...
    checks pass | checks fail NAME... (of arming.CHECKS) | estimator healthy/unhealthy | reset EAST NORTH UP
    say TEXT | forget gaps
    reboot [SILENT_S] | vanish | stranger SYSTEM_ID (another vehicle on the same link)
"""

from __future__ import annotations

import contextlib
import select
import signal
import socket
import struct
import time
from pathlib import Path

import click
from pymavlink.dialects.v20 import development as mavlink

from companion.core.clock import NS_PER_S
from companion.host.unix_datagram import bind_datagram_socket
from companion.signing.key import read_signing_key
from companion.sim import truth
from companion.sim.px4 import report
from companion.sim.px4.airframe import Airframe, AirframeLimits, Gusts
from companion.sim.px4.arming import CHECKS
from companion.sim.px4.clocks import PowerUpClock
from companion.sim.px4.commander import Commander, Mode
from companion.sim.px4.link import Px4Link
from companion.sim.px4.parameters import DEFAULTS, parsed
from companion.sim.px4.rover import RoverFrame
from companion.sim.px4.wander import Wander

_SO_TIMESTAMPNS = 35  # socket(7)
_TIMESPEC = struct.Struct("qq")
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size)
_TRUTH_PERIOD_NS = NS_PER_S // 100
_UP_S = 9.4
"""What the vehicle's own clock shows when the mock begins."""
_KINDS = {"px4": mavlink.MAV_AUTOPILOT_PX4, "ardupilot": mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA}


class Px4:
    """The mock without sockets: commander and link under one clock."""

    def __init__(
        self,
        now_ns: int,
        seed: int | None = None,
        yaw_enu_rad: float = 0.0,
        parameters: dict[str, int | float] | None = None,
        *,
        system_id: int = 1,
        kind: str = "px4",
        clock_rate: float = 1.0,
        drift_m: float = 0.5,
        signing_key: bytes | None = None,
        vehicle: str = "copter",
    ) -> None:
        """With `seed` there are gusts, and the estimate is off and wanders. `clock_rate`: of the vehicle's clock
        against ours. `drift_m`: how far the estimate's Up wanders before the takeoff."""
        gusts, wander = (None, None) if seed is None else (Gusts(seed), Wander(seed))
        drives = vehicle == "rover"
        airframe = RoverFrame(yaw_enu_rad, gusts) if drives else Airframe(AirframeLimits(), yaw_enu_rad, gusts)
        self.commander = Commander(airframe, now_ns, parameters, drift_m, wander)
        clock = PowerUpClock(now_ns, _UP_S, clock_rate)
        self.link = Px4Link(
            commander=self.commander,
            now_ns=now_ns,
            clock=clock,
            system_id=system_id,
            kind=_KINDS[kind],
            signing_key=signing_key,
        )
        self.strangers: list[Px4] = []
        """Other vehicles on the same link."""
        self._now_ns = now_ns

    def step(self, now_ns: int) -> list[bytes]:
        """Move time on; the datagrams to send."""
        self._now_ns = now_ns
        self.commander.step(now_ns)
        return [*self.link.telemetry(now_ns), *(d for other in self.strangers for d in other.step(now_ns))]

    def receive(self, datagram: bytes, now_ns: int) -> list[bytes]:
        """What every vehicle of the link answers to it."""
        answers = self.link.receive(datagram, now_ns)
        return [*answers, *(d for other in self.strangers for d in other.receive(datagram, now_ns))]

    def truth(self, now_ns: int) -> truth.VehicleTruth:
        commander, airframe = self.commander, self.commander.airframe
        return truth.VehicleTruth(
            t_mono_ns=now_ns,
            p_enu_m=airframe.p_enu_m,
            v_enu_m_s=airframe.v_enu_m_s,
            yaw_enu_rad=airframe.yaw_enu_rad,
            mode=commander.mode.name,
            armed=commander.armed,
            setpoints=commander.stream.received,
            setpoints_in_offboard=commander.stream.in_offboard,
            offboard_s=commander.offboard_s,
        )

    def report(self, now_ns: int, error: str | None = None) -> report.Px4Report:
        commander, link, state = self.commander, self.link, self.truth(now_ns)
        estimator = commander.estimator
        return report.Px4Report(
            t_mono_ns=now_ns,
            mode=state.mode,
            armed=state.armed,
            landed=commander.landed,
            failsafe=commander.failsafe,
            p_enu_m=state.p_enu_m,
            v_enu_m_s=state.v_enu_m_s,
            yaw_enu_rad=state.yaw_enu_rad,
            setpoints=state.setpoints,
            setpoints_in_offboard=state.setpoints_in_offboard,
            setpoints_outside=state.setpoints - state.setpoints_in_offboard,
            last_setpoint_mono_ns=commander.stream.last_ns,
            largest_gap_s=commander.stream.largest_gap_s,
            offboard_s=commander.offboard_s,
            peer_heartbeats=link.peer_heartbeats,
            timesync_answers=link.timesync_answers,
            onboard_statuses=link.onboard_statuses,
            refused=link.refused,
            vision=link.visions,
            vision_age_s=link.vision_age_s,
            vision_p_enu_m=None if link.vision is None else (link.vision.y, link.vision.x, -link.vision.z),
            vision_reset_counter=None if link.vision is None else link.vision.reset_counter,
            vision_fused=estimator.fused,
            vision_dropped=estimator.dropped,
            has_global_position=estimator.has_global_position,
            resets=estimator.resets,
            estimated_p_enu_m=commander.airframe.estimated_p_enu_m,
            clock_s=link.clock.ns(now_ns) / NS_PER_S,
            strangers=[other.report(now_ns) for other in self.strangers],
            received=dict(link.received),
            parameters={name: float(value) for name, value in commander.parameters.items()},
            history=[(t_ns, mode.name) for t_ns, mode in commander.history],
            error=error,
        )

    def order(self, text: str) -> str | None:
        """Carry out a test's order; why it was not understood, or None."""
        try:
            self._carry_out(text.split())
        except (ValueError, KeyError, IndexError) as error:
            return f"order {text!r}: {type(error).__name__}: {error}; see companion.sim.px4.autopilot for the words"
        return None

    def _carry_out(self, words: list[str]) -> None:
        match words:
            case ["report"]:
                pass
            case ["pilot", mode]:
                self.commander.pilot_mode(Mode[mode.upper()])
            case ["sticks", east, north, up]:
                self.commander.sticks((float(east), float(north), float(up)))
            case ["mute", "nothing" | "heartbeats" | "everything" as what]:
                self.link.mute = what
            case ["offboard", "accept" | "refuse" | "silent" as reply]:
                self.commander.refuse_offboard = reply == "refuse"
                self.link.ignore_mode_commands = reply == "silent"
            case ["battery", charge]:
                self._set_battery(0, charge)
            case ["battery", battery_id, charge]:
                self._set_battery(int(battery_id), charge)
            case ["parameter", name, value]:
                self.commander.parameters[name] = parsed(name, value)
            case ["parameters", "heard" | "silent" as reply]:
                self.link.ignore_parameter_requests = reply == "silent"
            case ["rc", *channels]:
                self.link.streams.rc_us = [int(channel) for channel in channels]
            case ["estimator", "healthy" | "unhealthy" as health]:
                self.commander.estimator.broken = health == "unhealthy"
            case ["checks", "pass"]:
                self.commander.failing_checks = ()
            case ["checks", "fail", *names] if names:
                self.commander.failing_checks = tuple(name for name in names if CHECKS[name])
            case ["reset", east, north, up]:
                self.commander.estimator.reset_by((float(east), float(north), float(up)))
            case ["say", *text]:
                self.link.say(" ".join(text))
            case ["forget", "gaps"]:
                self.commander.stream.largest_gap_s = 0.0
            case ["reboot", *silent_s]:
                self.link.reboot(self._now_ns, float(silent_s[0]) if silent_s else 0.0)
            case ["vanish"]:
                self.link.vanish()
            case ["stranger", system_id]:
                self.strangers.append(Px4(self._now_ns, system_id=int(system_id)))
            case _:
                raise ValueError("unknown")

    def _set_battery(self, battery_id: int, charge: str) -> None:
        batteries = self.link.streams.batteries
        if charge == "silent":
            batteries.pop(battery_id, None)
        else:
            batteries[battery_id] = None if charge == "unknown" else float(charge)


class Runner:
    """Turns `Px4` with the host's monotonic clock on real sockets until `stop`."""

    def __init__(
        self,
        *,
        px4: Px4,
        connect: tuple[str, int],
        rate_hz: float,
        truth: Path | None,
        control: Path | None,
        ground: tuple[str, int] | None = None,
    ) -> None:
        self._px4 = px4
        self._ground = None if ground is None else _connected(ground)
        self._period_ns = round(NS_PER_S / rate_hz)
        self._truth_path = truth
        self._truth = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._truth.setblocking(False)
        self._udp = _connected(connect)
        self._control_path = control
        self._control = bind_datagram_socket(control) if control is not None else None
        self._stopped = False

    def stop(self) -> None:
        self._stopped = True

    def run(self) -> None:
        tick_ns = truth_ns = time.monotonic_ns()
        sockets = [one for one in (self._udp, self._control, self._ground) if one is not None]
        while not self._stopped:
            now_ns = time.monotonic_ns()
            if now_ns >= tick_ns:
                tick_ns = max(tick_ns + self._period_ns, now_ns - 5 * self._period_ns)
                telemetry = self._px4.step(now_ns)
                # What is due together goes out together: a datagram costs each end more than what it holds.
                self._send([b"".join(telemetry)] if telemetry else [])
                self._send_to_ground([*telemetry, *self._px4.link.take_handed_on()])
            if now_ns >= truth_ns:
                truth_ns = max(truth_ns + _TRUTH_PERIOD_NS, now_ns)
                self._send_truth(now_ns)
            readable, _, _ = select.select(sockets, [], [], max(0, tick_ns - time.monotonic_ns()) / NS_PER_S)
            if self._udp in readable:
                self._receive()
            if self._control in readable:
                self._answer()
            if self._ground in readable:
                self._receive_from_ground()

    def close(self) -> None:
        self._udp.close()
        if self._ground is not None:
            self._ground.close()
        self._truth.close()
        if self._control is not None and self._control_path is not None:
            self._control.close()
            self._control_path.unlink(missing_ok=True)

    def _send(self, datagrams: list[bytes]) -> None:
        for datagram in datagrams:
            # Nobody listens yet, or no longer: an autopilot sends on regardless.
            with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
                self._udp.send(datagram)

    def _send_to_ground(self, datagrams: list[bytes]) -> None:
        if self._ground is None:
            return
        for datagram in datagrams:
            with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
                self._ground.send(datagram)

    def _receive_from_ground(self) -> None:
        """Its other link: answered there, and handed on to the companion."""
        assert self._ground is not None
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            while True:
                self._send_to_ground(self._px4.receive(self._ground.recv(2048), time.monotonic_ns()))
                self._send(self._px4.link.take_handed_on())

    def _receive(self) -> None:
        while True:
            try:
                datagram, ancillary, _, _ = self._udp.recvmsg(2048, _ANCILLARY_BYTES)
            except ConnectionRefusedError:
                continue
            except BlockingIOError:
                return
            self._send(self._px4.receive(datagram, _arrival_ns(ancillary)))

    def _send_truth(self, now_ns: int) -> None:
        if self._truth_path is None:
            return
        with contextlib.suppress(FileNotFoundError, ConnectionRefusedError, BlockingIOError):
            self._truth.sendto(truth.encode(self._px4.truth(now_ns)), str(self._truth_path))

    def _answer(self) -> None:
        assert self._control is not None
        datagram, sender = self._control.recvfrom(1024)
        error = self._px4.order(datagram.decode(errors="replace"))
        answer = report.encode(self._px4.report(time.monotonic_ns(), error))
        with contextlib.suppress(FileNotFoundError, ConnectionRefusedError, BlockingIOError):
            if sender:  # a sender without a name of its own wants no answer
                self._control.sendto(answer, sender)


def _connected(address: tuple[str, int]) -> socket.socket:
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    udp.setblocking(False)
    udp.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    udp.connect(address)
    return udp


def _arrival_ns(ancillary: list[tuple[int, int, bytes]]) -> int:
    """When the kernel took the datagram: a mock that waits for a processor must not count its own delay as a gap."""
    now_ns = time.monotonic_ns()
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) == _TIMESPEC.size:
            seconds, nanoseconds = _TIMESPEC.unpack(data)
            age_ns = time.time_ns() - (seconds * NS_PER_S + nanoseconds)
            return now_ns - int(min(max(0, age_ns), NS_PER_S))
    return now_ns


def _address(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, int] | None:
    if value is None:
        return None
    host, _, port = value.rpartition(":")
    if not host or not port.isdecimal():
        raise click.BadParameter(f"{value!r}: expected HOST:PORT, for example 127.0.0.1:14540")
    return host, int(port)


def _parameters(context: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> dict[str, int | float]:
    try:
        return {name: parsed(name, text) for name, _, text in (v.partition("=") for v in values)}
    except (KeyError, ValueError) as error:
        raise click.BadParameter(f"{error}: expected NAME=VALUE with one of {', '.join(DEFAULTS)}") from None


@click.command()
@click.option("--connect", required=True, callback=_address, metavar="HOST:PORT", help="the companion's UDP port")
@click.option("--ground", callback=_address, metavar="HOST:PORT", help="a ground station's UDP port: its second link")
@click.option("--truth", "truth_path", type=click.Path(path_type=Path), help="unix datagram socket of the world")
@click.option("--control", type=click.Path(path_type=Path), help="unix datagram socket to take a test's orders on")
@click.option("--rate", default=100.0, show_default=True, help="steps per second")
@click.option("--seed", type=int, help="gusts and estimator error; without it the air is still")
@click.option("--yaw", "yaw_enu_rad", default=0.0, help="start yaw, counter-clockwise from East [rad]")
@click.option("--system-id", default=1, show_default=True, help="the vehicle's MAVLink system id")
@click.option("--kind", type=click.Choice(sorted(_KINDS)), default="px4", show_default=True, help="what it says it is")
@click.option("--clock-rate", default=1.0, show_default=True, help="of the vehicle's clock against the host's")
@click.option("--drift", "drift_m", default=0.5, show_default=True, help="of the estimate's Up on the ground [m]")
@click.option("--signing-key", type=click.Path(path_type=Path), help="file of the key that it signs with and demands")
@click.option("--vehicle", type=click.Choice(["copter", "rover"]), default="copter", show_default=True)
@click.option("--param", "parameters", multiple=True, callback=_parameters, help="a parameter, NAME=VALUE")
def main(
    connect: tuple[str, int],
    ground: tuple[str, int] | None,
    truth_path: Path | None,
    control: Path | None,
    rate: float,
    seed: int | None,
    yaw_enu_rad: float,
    system_id: int,
    kind: str,
    clock_rate: float,
    drift_m: float,
    signing_key: Path | None,
    vehicle: str,
    parameters: dict[str, int | float],
) -> None:
    """A mock PX4 for simulation and tests."""
    px4 = Px4(
        time.monotonic_ns(), seed, yaw_enu_rad, parameters,
        system_id=system_id, kind=kind, clock_rate=clock_rate, drift_m=drift_m, vehicle=vehicle,
        signing_key=None if signing_key is None else read_signing_key(signing_key),
    )  # fmt: skip
    runner = Runner(px4=px4, connect=connect, rate_hz=rate, truth=truth_path, control=control, ground=ground)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: runner.stop())
    try:
        runner.run()
    finally:
        runner.close()


if __name__ == "__main__":
    main()
