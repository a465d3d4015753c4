"""Two robots are heard and the vehicle is sent to the other one in flight: the service's own parts and the mock PX4, in
virtual time. Bearings are true to where the robots stand."""

from __future__ import annotations

import asyncio
import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import pytest

from companion.config.schema import Peer
from companion.core.messages import Setpoint, Vector3
from companion.mission.table import State
from companion.neighbours import wire
from companion.neighbours.sender import NeighbourSender
from companion.radio.card import ANTENNAS, ChannelSample
from companion.sensing.worker_wire import AoaResult
from companion.sim.stage import Stage, set_stage
from csi_bridge.records import SUBCARRIERS
from tests.faults import virtual_flight
from tests.faults.test_long_mission import _Worker
from tests.faults.virtual_flight import VirtualFlight, noted_setpoints
from wsr.aperture import Aperture

_SECOND: Final = 3
_KEY: Final = bytes(range(32))
_BOOT_ID: Final = 1 << 40
_PLACES_M: Final[dict[int, Vector3]] = {2: (7.0, 0.0, 0.5), _SECOND: (1.5, 4.0, 0.5)}
_MOST_STEP_M_S2: Final = 0.5
_LONGEST_TICK_S: Final = 0.07


class _TrueWorker(_Worker):
    """Answers each aperture with the direction in which its robot stands."""

    flight: VirtualFlight

    def submit(self, peer: int, aperture: Aperture) -> int:
        number = super().submit(peer, aperture)
        result: AoaResult = self.waiting[-1]
        assert result.estimate is not None
        here_m = self.flight.px4.commander.airframe.p_enu_m
        east, north, up = (there - here for there, here in zip(_PLACES_M[peer], here_m, strict=True))
        estimate = replace(
            result.estimate,
            azimuth_rad=math.atan2(north, east),
            polar_rad=math.acos(up / math.hypot(east, north, up)),
            polar_std_rad=0.05,
            polar_observable=True,
        )
        self.waiting[-1] = replace(result, estimate=estimate)
        return number


class _TwoRobots(VirtualFlight):
    def __init__(self, directory: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(virtual_flight, "set_stage", _stage)
        monkeypatch.setattr(virtual_flight, "_Worker", _TrueWorker)
        super().__init__(directory=directory, out=out, monkeypatch=monkeypatch)
        assert isinstance(self.worker, _TrueWorker)
        self.worker.flight = self
        self.second = NeighbourSender(
            role=wire.Role.BEACON, own_id=_SECOND, key=_KEY, pose_rate_hz=50.0, boot_id=_BOOT_ID
        )
        self.is_second_heard = True
        give = self.uav.node.samples.give  # power falls with the distance
        self.uav.node.samples.give = lambda one: give(one._replace(power_dbm=self._power(one.peer)))  # type: ignore[method-assign,assignment]
        self.setpoints = noted_setpoints(self, monkeypatch)

    async def tick(self) -> None:
        if self.is_second_heard:
            for datagram in self.second.datagrams(self.clock.now_ns()):
                self.uav.node.receiver.take(datagram)
        await super().tick()

    def _sense(self) -> None:
        super()._sense()
        if not self.is_second_heard:
            return
        now_ns = self.clock.now_ns()
        if self.second.wants_pose(now_ns):
            self.second.add_pose(now_ns, np.zeros(3), 3)
        csi = np.zeros((SUBCARRIERS, ANTENNAS), np.complex64)
        csi[:, 0] = 10 + 10j
        nic_us = now_ns // 1000 & 0xFFFFFFFF
        self.uav.node.samples.give(
            ChannelSample(
                peer=_SECOND, frame=self._frame, t_mono_ns=now_ns, nic_us=nic_us, channel=csi, power_dbm=-50.0
            )
        )
        self.second.add_channel(self._frame, now_ns, nic_us, csi[:, 0], power_dbm=-50.0, antenna=0)

    def away_m(self, peer: int) -> float:
        return math.dist(self.px4.commander.airframe.p_enu_m, _PLACES_M[peer])

    def _power(self, peer: int) -> float:
        return -40.0 - 20.0 * math.log10(self.away_m(peer))


def _stage(directory: Path, out: Path, seed: int, use_netlink: bool, gps: bool) -> Stage:
    stage = set_stage(directory, out, seed=seed, use_netlink=use_netlink, gps=gps)
    key = stage.uav.path("second.key")
    key.write_bytes(_KEY)
    key.chmod(0o600)
    second = Peer(_SECOND, "second", "00:21:6A:00:00:03", key.name)
    return replace(stage, uav=replace(stage.uav, peers=[*stage.uav.peers, second]))


@pytest.fixture
async def flight(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    flown = _TwoRobots(tmp_path_factory.mktemp("v"), tmp_path, monkeypatch)
    try:
        async with flown.flight._commands:
            await flown.run(2.0)
            yield flown
            flown.flight._commands.cancel()  # after a failure nobody moves its clock on
    finally:
        flown.close()


async def _engage(flight: _TwoRobots, target: str | None) -> str:
    asking = asyncio.create_task(flight.flight.wishes.engage(target))
    while not asking.done():
        await flight.tick()
    return asking.result()


def _steps_m_s2(setpoints: list[Setpoint]) -> list[float]:
    """Changes of the commanded acceleration from one tick to the next."""
    t_s = np.array([setpoint.t_mono_ns for setpoint in setpoints]) * 1e-9
    v_m_s = np.array([setpoint.v_local_enu_m_s for setpoint in setpoints])
    a_m_s2 = np.diff(v_m_s, axis=0) / np.diff(t_s)[:, None]
    return list(np.linalg.norm(np.diff(a_m_s2, axis=0), axis=1).tolist())


async def test_another_robot_in_flight_bends_the_path_and_makes_no_step(flight: _TwoRobots) -> None:
    assert (
        await _engage(flight, "gamma") == "no robot has the name or id 'gamma'; expected one of beacon (2), second (3)"
    )
    assert await _engage(flight, "beacon") == ""
    await flight.until(State.APPROACHING)
    await flight.run(3.0)
    before_m = flight.away_m(_SECOND)
    assert flight.flight.status()["target_name"] == "beacon"
    sent = len(flight.setpoints)
    assert await _engage(flight, "3") == ""
    await flight.until(State.ACQUIRING, timeout_s=0.2)
    told = flight.flight.status()
    assert told["target_name"] == "second" and told["target"] is not None, "it was tracked all the time"
    assert flight.report().mode == "OFFBOARD"
    await flight.until(State.ARRIVED, timeout_s=60.0)
    assert flight.away_m(_SECOND) < 2.5 < flight.away_m(2) and before_m > 2.5
    stream = flight.setpoints
    steps = _steps_m_s2(stream)
    assert max(steps[sent - 5 : sent + 60]) <= _MOST_STEP_M_S2
    assert max(steps) <= _MOST_STEP_M_S2 * _LONGEST_TICK_S / 0.05, "ticks are not even here"
    gaps_s = [(b.t_mono_ns - a.t_mono_ns) / 1e9 for a, b in itertools.pairwise(stream[sent - 5 :])]
    assert max(gaps_s) < _LONGEST_TICK_S, "nothing is left out at the change"


async def test_a_silent_robot_is_not_flown_to_and_an_abort_latches_whatever_was_named(flight: _TwoRobots) -> None:
    assert await _engage(flight, "beacon") == ""
    await flight.until(State.APPROACHING)
    flight.is_second_heard = False
    await flight.run(2.5)
    assert await _engage(flight, "second") == "second: no datagrams of the target; second: no packets of the target"
    assert flight.flight.state is State.APPROACHING and flight.flight.status()["target_name"] == "beacon"
    flight.is_second_heard = True
    await flight.run(2.5)
    assert await _engage(flight, "second") == ""
    flight.flight.wishes.abort()
    await flight.until(State.LATCHED, timeout_s=0.2)
    sent = len(flight.setpoints)
    await flight.run(2.0)
    assert len(flight.setpoints) == sent and flight.report().mode == "HOLD"
    assert flight.flight.status()["target_name"] == "second"
