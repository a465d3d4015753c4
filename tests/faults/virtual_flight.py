"""A whole flight in virtual time: the service's own parts, the edge and the mock PX4 with its own estimator, no sockets
between them. Without GPS the mock flies by the poses that the service sends it."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.autopilot import mavsdk_edge
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.messages import Setpoint, Vector3, VehicleState
from companion.log.recorder import McapRecorder
from companion.mission.table import State
from companion.radio.card import ANTENNAS, ChannelSample
from companion.roles.inputs import LiveInputs
from companion.roles.node import Node
from companion.roles.uav import Uav
from companion.sim.px4.autopilot import Px4
from companion.sim.px4.report import Px4Report
from companion.sim.stage import set_stage
from csi_bridge.records import SUBCARRIERS
from tests.faults.test_long_mission import _Clock, _Worker
from tests.level_pose import level_pose
from tests.unit.companion.autopilot.virtual_vehicle import VirtualVehicle

GPS_DENIED: dict[str, int | float] = {
    "SYS_HAS_GPS": 0, "EKF2_GPS_CTRL": 0, "EKF2_HGT_REF": 3, "EKF2_EV_CTRL": 11,
}  # fmt: skip
_GOOD: dict[str, int | float] = {"COM_OBL_RC_ACT": 5, "COM_RC_OVERRIDE": 3, "RTL_RETURN_ALT": 3.0}
_POSES_PER_TICK = 5


class VirtualFlight:
    """Moved on by `run`; `pose_offset_m` is how far the tracker's frame is from where it began."""

    def __init__(
        self, *, directory: Path, out: Path, monkeypatch: pytest.MonkeyPatch, gps: bool = True,
        clock_rate: float = 1.0, **parameters: int | float,
    ) -> None:  # fmt: skip
        """`parameters` of the vehicle, over those that the preflight accepts; `clock_rate` is its clock's to ours."""
        monkeypatch.setattr(mavsdk_edge, "_POLL_S", 0.0)  # real time must not pass between two looks
        stage = set_stage(directory, out, seed=1, use_netlink=False, gps=gps)
        uav = replace(stage.uav, mission=replace(stage.uav.mission, hold_limit_s=4.0))
        self.clock = _Clock(6844 * NS_PER_S)
        clock = EventClock(self.clock)
        self.recorder = McapRecorder(uav.path(uav.recorder.path), uav, clock)
        self.worker = _Worker()
        self.vehicle = VirtualVehicle(
            clock=self.clock,
            parameters=_GOOD | ({} if gps else GPS_DENIED) | parameters,
            drift_m=0.5,
            clock_rate=clock_rate,
        )
        self.uav = Uav(
            config=uav, clock=clock, recorder=self.recorder, inputs=LiveInputs(uav),
            make_autopilot=lambda _: self.vehicle.edge, worker=self.worker,
        )  # fmt: skip
        self.flight = self.uav.flight
        self.vehicle.edge._problem = ""
        self.vehicle.edge._ask_for_telemetry()
        self.beacon = Node(stage.beacon, clock, self.recorder, LiveInputs(stage.beacon))
        self.pose_offset_m: Vector3 = (0.0, 0.0, 0.0)
        self.has_poses = self.is_heard = True
        self.states: list[State] = []
        self.truths: list[tuple[Vector3, Vector3]] = []
        """True position and velocity at each tick."""
        self._frame = self._ticks = 0

    @property
    def px4(self) -> Px4:
        return self.vehicle.px4

    @property
    def state(self) -> VehicleState:
        return self.vehicle.state()

    def report(self) -> Px4Report:
        return self.px4.report(self.clock.now_ns())

    def order(self, text: str) -> None:
        assert self.px4.order(text) is None

    def close(self) -> None:
        self.recorder.close()
        for node in (self.uav.node, self.beacon):
            node.close()

    async def engage(self) -> str:
        """The answer; time goes on while parameters are read."""
        asking = asyncio.create_task(self.flight.wishes.engage())
        while not asking.done():
            await self.tick()
        return asking.result()

    async def run(self, seconds: float) -> None:
        end_ns = self.clock.now_ns() + round(seconds * NS_PER_S)
        while self.clock.now_ns() < end_ns:
            await self.tick()

    async def seconds_until(self, holds: Callable[[], bool], timeout_s: float = 10.0) -> float:
        """How long it took."""
        begin_ns = self.clock.now_ns()
        while not holds():
            assert self.clock.now_ns() < begin_ns + timeout_s * NS_PER_S, self.report()
            await self.tick()
        return round((self.clock.now_ns() - begin_ns) / NS_PER_S, 2)

    async def until(self, *states: State, timeout_s: float = 60.0) -> None:
        end_ns = self.clock.now_ns() + round(timeout_s * NS_PER_S)
        while self.flight.state not in states:
            assert self.clock.now_ns() < end_ns, (self.flight.state, self.flight._course.reason, self.report())
            await self.tick()

    async def tick(self) -> None:
        for _ in range(_POSES_PER_TICK):
            self.vehicle.run(0.01)
            self._sense()
        self._ticks += 1
        if self._ticks % 2:
            self.vehicle.edge._ask_again()
        now_ns = self.clock.now_ns()
        if self.is_heard:
            for datagram in self.beacon.sender.datagrams(now_ns):
                self.uav.node.receiver.take(datagram)
        while self.worker.waiting:
            self.uav.sar.take_answer(self.worker.waiting.pop(0))
        self.flight.tick(now_ns)
        self.vehicle._flush()
        airframe = self.px4.commander.airframe
        self.truths.append((airframe.p_enu_m, airframe.v_enu_m_s))
        if self.flight.state not in self.states[-1:]:
            self.states.append(self.flight.state)
        for _ in range(3):
            await asyncio.sleep(0)

    def top_speed_m_s(self, since: int) -> float:
        """Over the ticks from one on."""
        return max(math.hypot(*v) for _, v in self.truths[since:])

    def _sense(self) -> None:
        now_ns, airframe = self.clock.now_ns(), self.px4.commander.airframe
        if self.has_poses:
            x, y, z = (p + o for p, o in zip(airframe.p_enu_m, self.pose_offset_m, strict=True))
            self.uav.node.intake.take(level_pose(now_ns, (x, y, z), airframe.v_enu_m_s))
        self.beacon.intake.take(level_pose(now_ns, (50.0, 0.0, 0.5)))
        if not self.is_heard:
            return
        nic_us = now_ns // 1000 & 0xFFFFFFFF
        csi = np.zeros((SUBCARRIERS, ANTENNAS), np.complex64)
        csi[:, 0] = 10 + 10j
        self.uav.node.radio.nic_clock.update(nic_us, now_ns)
        self._frame += 1
        self.uav.node.samples.give(
            ChannelSample(peer=2, frame=self._frame, t_mono_ns=now_ns, nic_us=nic_us, channel=csi, power_dbm=-50.0)
        )
        self.beacon.sender.add_channel(self._frame, now_ns, nic_us, csi[:, 0], power_dbm=-50.0, antenna=0)


def noted_setpoints(flight: VirtualFlight, monkeypatch: pytest.MonkeyPatch) -> list[Setpoint]:
    """Every set point that leaves from now on, as it leaves."""
    noted: list[Setpoint] = []
    send = flight.uav.autopilot.send_setpoint

    def note(setpoint: Setpoint) -> None:
        noted.append(setpoint)
        send(setpoint)

    monkeypatch.setattr(flight.uav.autopilot, "send_setpoint", note)
    return noted
