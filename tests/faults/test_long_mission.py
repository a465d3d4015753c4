"""Fault 7: a long mission, faster than real time, must not grow.

The service's own parts (flight loop, gate, SAR window, neighbours with signed datagrams, pose intake, recorder) on a
manual clock; the autopilot is the mock's commander without its sockets, the AOA worker an answer that leads the vehicle
in circles. Two minutes in `make test`, thirty in `make faults`.
"""

from __future__ import annotations

import asyncio
import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.messages import AutopilotEvent, FlightMode, Pose, Setpoint, VehicleState
from companion.flight.loop import Flight
from companion.log.recorder import McapRecorder
from companion.mission.table import State
from companion.radio.card import ANTENNAS, ChannelSample
from companion.roles.inputs import LiveInputs
from companion.roles.node import Node
from companion.safety.preflight import REQUIREMENTS
from companion.sensing.iterations import SarIterations
from companion.sensing.window import SarWindow
from companion.sensing.worker_wire import AoaResult
from companion.sim.px4.airframe import Airframe, AirframeLimits, Demand, Gusts
from companion.sim.px4.commander import Commander, Mode
from companion.sim.stage import set_stage
from csi_bridge.records import SUBCARRIERS
from tests.faults.campaigns import runs
from tests.faults.figures import record
from tests.level_pose import level_pose
from tests.manual_clock import ManualClock
from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture
from wsr.channel import wavelength_m

_RATE_HZ = 20
_POSES_PER_TICK = 5
_MODES = {
    Mode.OFFBOARD: FlightMode.OFFBOARD, Mode.HOLD: FlightMode.HOLD, Mode.TAKEOFF: FlightMode.TAKEOFF,
    Mode.RTL: FlightMode.RETURN, Mode.LAND: FlightMode.LAND, Mode.POSCTL: FlightMode.MANUAL,
}  # fmt: skip
_GOOD = {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 5, "COM_RC_OVERRIDE": 3, "GF_ACTION": 2, "SYS_HAS_GPS": 1, "EKF2_EV_CTRL": 0, "RTL_RETURN_ALT": 3.0, "GF_MAX_VER_DIST": 0.0, "NAV_MC_ALT_RAD": 0.8, "COM_TAKEOFF_ACT": 0}  # fmt: skip # noqa: E501


class _Clock(ManualClock):
    """Who sleeps waits for the ticks to bring the time, instead of making it."""

    async def sleep_until_ns(self, deadline_ns: int) -> None:
        while self.now_ns() < deadline_ns:  # noqa: ASYNC110 - time moves elsewhere
            await asyncio.sleep(0)


class _Autopilot:
    """The commander of the mock behind the port, without a link."""

    problem = ""

    def __init__(self, clock: ManualClock, gusts: Gusts | None = None) -> None:
        self._clock = clock
        self.commander = Commander(Airframe(AirframeLimits(), 0.0, gusts), clock.now_ns())
        self.setpoints = 0

    async def connect(self, timeout_s: float = 10.0) -> None: ...

    async def run(self) -> None: ...

    async def aclose(self) -> None: ...

    def state(self) -> VehicleState:
        now_ns, commander = self._clock.now_ns(), self.commander
        airframe = commander.airframe
        return VehicleState(
            t_mono_ns=now_ns,
            heartbeat_mono_ns=now_ns,
            mode=_MODES.get(commander.mode, FlightMode.OTHER),
            mode_mono_ns=now_ns,
            armed=commander.armed,
            in_air=not commander.landed,
            failsafe=commander.failsafe,
            position_mono_ns=now_ns,
            p_local_enu_m=airframe.p_enu_m,
            v_local_enu_m_s=airframe.v_enu_m_s,
            yaw_enu_rad=airframe.yaw_enu_rad,
            battery_remaining=0.9,
            estimator_mono_ns=now_ns,
            estimator_healthy=True,
            timesync_mono_ns=now_ns,
        )

    def send_setpoint(self, setpoint: Setpoint) -> None:
        assert setpoint.p_local_enu_m is not None
        self.setpoints += 1
        self.commander.set_point(Demand(setpoint.p_local_enu_m, setpoint.v_local_enu_m_s), self._clock.now_ns())

    def send_odometry(self, pose: Pose, reset_counter: int) -> None: ...

    def set_origin(self, latitude_deg: float, longitude_deg: float) -> None: ...

    def take_events(self) -> list[AutopilotEvent]:
        return []

    async def arm(self) -> None:
        self.commander.arm(self._clock.now_ns())

    async def takeoff(self, height_m: float) -> None:
        self.commander.parameters["MIS_TAKEOFF_ALT"] = height_m
        self.commander.command_takeoff()
        while self.commander.mode is not Mode.HOLD:  # noqa: ASYNC110 - time moves elsewhere
            await asyncio.sleep(0)

    async def request_offboard(self) -> None:
        self.commander.command_mode(Mode.OFFBOARD, self._clock.now_ns())

    async def hold(self) -> None:
        self.commander.command_mode(Mode.HOLD, self._clock.now_ns())

    async def land(self) -> None:
        self.commander.command_mode(Mode.LAND, self._clock.now_ns())

    async def return_home(self) -> None:
        self.commander.command_mode(Mode.RTL, self._clock.now_ns())

    async def parameter(self, name: str) -> int | float:
        assert name in {requirement.name for requirement in REQUIREMENTS}
        return _GOOD[name]


class _Worker:
    """Answers each aperture at the next tick; directions turn by the golden angle: they never agree."""

    def __init__(self) -> None:
        self.ready = asyncio.Event()
        self.ready.set()
        self.waiting: list[AoaResult] = []
        self.submitted = 0

    def submit(self, peer: int, aperture: Aperture) -> int:
        azimuth = math.remainder(math.radians(137.508 * self.submitted), math.tau)
        infinite = ((1e-3, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0, math.inf))
        place = (0.0, 0.0, 0.0)
        estimate = AoaEstimate(
            azimuth_rad=azimuth,
            polar_rad=math.pi / 2,
            azimuth_std_rad=0.03,
            polar_std_rad=math.inf,
            covariance=infinite,
            crb_rad=0.02,
            coherence=0.9,
            reliability=0.9,
            azimuth_observable=True,
            polar_observable=False,
            alternatives=(),
            packets=aperture.packets,
            length_m=1.2,
            extents_m=place,
            reference_p_m=place,
            reference_t_s=float(aperture.t_s.mean()),
        )
        self.waiting.append(
            AoaResult(id=self.submitted, peer=peer, compute_s=0.01, estimate=estimate, profile=bytes(180 * 360 * 2))
        )
        self.submitted += 1
        return self.submitted - 1


class _Service:
    """Everything in one process, moved on by `tick`."""

    def __init__(
        self, directory: Path, out: Path, gusts: Gusts | None = None, limit_s: float = 1e6, **gate: Any
    ) -> None:
        """`gate` replaces values of that section of the configuration."""
        stage = set_stage(directory, out, seed=1, use_netlink=False)
        mission = replace(stage.uav.mission, limit_s=limit_s)
        uav = replace(stage.uav, mission=mission, gate=replace(stage.uav.gate, **gate))
        self.clock = _Clock(10**12)
        clock = EventClock(self.clock)
        self.recorder = McapRecorder(uav.path(uav.recorder.path), uav, clock)
        aperture = uav.aperture
        wavelength = wavelength_m(uav.csi.channel)
        window = SarWindow(
            antenna_m=uav.pose.antenna_m,
            wavelength_m=wavelength,
            min_packets=aperture.min_packets,
            max_pose_gap_s=aperture.max_pose_gap_s,
        )
        self.node = Node(uav, clock, self.recorder, LiveInputs(uav))
        self.node.poses.connect(window.add_pose)
        self.beacon = Node(stage.beacon, clock, self.recorder, LiveInputs(stage.beacon))
        self.worker, self.autopilot = _Worker(), _Autopilot(self.clock, gusts)
        neighbours, intake = self.node.receiver.neighbours, self.node.intake
        self.sar = SarIterations(
            window=window, worker=self.worker, neighbours=neighbours, config=aperture, clock=clock,
            recorder=self.recorder, lookalikes=self.node.lookalikes, pose_problem=intake.problem_between,
        )  # fmt: skip
        self.flight = Flight(
            config=uav, clock=clock, intake=intake, neighbours=neighbours, autopilot=self.autopilot, sar=self.sar,
            recorder=self.recorder,
        )  # fmt: skip
        self.sar.iterations.connect(self.flight.knowledge.add_iteration)
        self.node.samples.connect(window.add_sample, self.flight.knowledge.heard)
        self._frame = 0

    def close(self) -> None:
        self.recorder.close()
        for node in (self.node, self.beacon):
            node.close()

    async def tick(self) -> None:
        for _ in range(_POSES_PER_TICK):
            self.clock.advance(1 / _RATE_HZ / _POSES_PER_TICK)
            self._sense()
        now_ns = self.clock.now_ns()
        self.autopilot.commander.step(now_ns)
        for datagram in self.beacon.sender.datagrams(now_ns):
            self.node.receiver.take(datagram)
        while self.worker.waiting:
            self.sar.take_answer(self.worker.waiting.pop(0))
        self.flight.tick(now_ns)
        await asyncio.sleep(0)

    def _sense(self) -> None:
        now_ns, airframe = self.clock.now_ns(), self.autopilot.commander.airframe
        self.node.intake.take(level_pose(now_ns, airframe.p_enu_m, airframe.v_enu_m_s))
        self.beacon.intake.take(level_pose(now_ns, (50.0, 0.0, 0.5)))
        nic_us = now_ns // 1000 & 0xFFFFFFFF
        csi = np.zeros((SUBCARRIERS, ANTENNAS), np.complex64)
        csi[:, 0] = 10 + 10j
        self._frame += 1
        self.node.samples.give(
            ChannelSample(peer=2, frame=self._frame, t_mono_ns=now_ns, nic_us=nic_us, channel=csi, power_dbm=-50.0)
        )
        self.beacon.sender.add_channel(self._frame, now_ns, nic_us, csi[:, 0], power_dbm=-50.0, antenna=0)


def _resident_mib() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / (1 << 20)


def _open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.long
async def test_fault_07_a_long_mission_does_not_grow(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    minutes = runs(2, 30)
    service = _Service(tmp_path_factory.mktemp("s"), tmp_path)
    settled: dict[str, Any] = {}
    started_s = time.monotonic()
    try:
        async with service.flight._commands:
            for index in range(minutes * 60 * _RATE_HZ):
                await service.tick()
                if index == 2 * _RATE_HZ:
                    assert await service.flight.wishes.engage() == ""
                if index == minutes * 60 * _RATE_HZ // 2:
                    settled = {"mib": _resident_mib(), "files": _open_files(), "tasks": len(asyncio.all_tasks())}
            grown_mib = _resident_mib() - settled["mib"]
            files, tasks = _open_files() - settled["files"], len(asyncio.all_tasks()) - settled["tasks"]
    finally:
        service.close()
    taken_s = time.monotonic() - started_s
    record(
        7, minutes=minutes, faster_than_real_time=round(minutes * 60 / taken_s, 1), grown_mib=round(grown_mib, 2),
        files=files, tasks=tasks, iterations=service.worker.submitted,
    )  # fmt: skip
    assert service.flight.state is State.APPROACHING and service.autopilot.setpoints > minutes * 60 * _RATE_HZ * 0.8
    assert service.worker.submitted > 5 * minutes and service.recorder.dropped == 0
    assert service.clock.now_ns() > 10**12 + (minutes * 60 - 1) * NS_PER_S
    assert grown_mib < 5 and files <= 0 and tasks <= 0


@pytest.mark.long
async def test_a_fence_in_the_way_is_kept_and_ends_the_mission(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The target lies beyond it, and there are gusts: the vehicle flies on inside, as near as it may, and lands when
    its time is over."""
    service = _Service(tmp_path_factory.mktemp("s"), tmp_path, Gusts(4), limit_s=25.0, fence_radius_m=1.5)
    farthest_m, refused, states = 0.0, 0, list[State]()
    try:
        async with service.flight._commands:
            for index in range(75 * _RATE_HZ):
                await service.tick()
                if index == 2 * _RATE_HZ:
                    assert await service.flight.wishes.engage() == ""
                refused += bool(service.flight._refusals.reasons) and service.flight._streaming
                farthest_m = max(farthest_m, math.hypot(*service.autopilot.commander.airframe.p_enu_m[:2]))
                if service.flight.state not in states[-1:]:
                    states.append(service.flight.state)
    finally:
        service.close()
    print(f"farthest {farthest_m:.2f} m, {refused} set points refused, {' '.join(states)}")
    assert refused < 100 and 0.6 < farthest_m < 1.5 + 0.3
    assert states[4:] == [State.APPROACHING, State.LANDING, State.IDLE], "it has landed by itself"
    assert service.autopilot.commander.landed and service.autopilot.commander.mode is Mode.HOLD
