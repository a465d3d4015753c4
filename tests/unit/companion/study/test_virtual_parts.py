"""What stands in for hardware in a virtual mission."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.random import SeedSequence

from companion.core.clock import NS_PER_S
from companion.core.messages import FlightMode, Setpoint
from companion.sim.scenario import RadioScenario, Scenario
from companion.study.link import CLOCK_OFFSET_S, scenario, standing
from companion.study.virtual_parts import (
    BEACON_ID,
    PARAMETERS,
    UAV_ID,
    CameraFeed,
    InlineWorker,
    RadioFeed,
    Vehicle,
)
from tests.manual_clock import ManualClock
from wsr.aperture import Aperture

_UAV_M, _BEACON_M = np.array([0.0, 0.0, 1.5]), np.array([6.0, 2.0, 0.5])


def _world() -> Scenario:
    return scenario(SeedSequence(1), RadioScenario(reflectors=(), loss_probability=0.0))


async def test_a_vehicle_follows_set_points_in_offboard_alone() -> None:
    vehicle = Vehicle(1, 2, 1.5, ManualClock(5))  # type: ignore[arg-type]
    vehicle.send_setpoint(Setpoint(0, (2.0, 0.0, 1.5), (0.0, 0.0, 0.0), 0.0))
    for _ in range(200):
        vehicle.step()
    assert math.hypot(*vehicle.airframe.p_enu_m[:2]) < 0.5, "it hovers"
    await vehicle.request_offboard()
    assert vehicle.state().mode is FlightMode.OFFBOARD
    for _ in range(400):
        vehicle.step()
    assert vehicle.airframe.p_enu_m[0] == pytest.approx(2.0, abs=0.5)
    before_m = vehicle.airframe.p_enu_m
    await vehicle.hold()
    for _ in range(200):
        vehicle.step()
    assert math.dist(vehicle.airframe.p_enu_m, before_m) < 0.2, "a place of the estimate is held, not of the truth"
    assert (vehicle.state().mode, vehicle.state().t_mono_ns) == (FlightMode.HOLD, 5)
    assert await vehicle.parameter("GF_ACTION") == PARAMETERS["GF_ACTION"]


def test_a_camera_gives_each_frame_once_on_its_robots_own_clock() -> None:
    world = _world()
    camera, other = CameraFeed(world, 0), CameraFeed(world, 1)
    first = camera.poses(1.0, standing(_UAV_M, 0.0, 3.0))
    second = camera.poses(2.0, standing(_UAV_M, 0.0, 3.0))
    period_ns = NS_PER_S / world.vio.rate_hz
    times = [pose.t_mono_ns for pose in (*first, *second)]
    assert np.diff(times) == pytest.approx(period_ns, abs=2)
    assert times[-1] <= 2 * NS_PER_S
    assert camera.received == len(times)
    theirs = other.poses(1.0, standing(_BEACON_M, 0.0, 3.0))
    assert theirs[0].t_mono_ns - first[0].t_mono_ns == round(CLOCK_OFFSET_S * NS_PER_S)


def test_each_card_hears_the_other_robot() -> None:
    radio = RadioFeed(_world())
    heard = radio.samples(0.5, standing(_UAV_M, 0.0, 1.0), standing(_BEACON_M, 0.0, 1.0))
    ours = [sample for is_ours, sample in heard if is_ours]
    theirs = [sample for is_ours, sample in heard if not is_ours]
    assert {sample.peer for sample in ours} == {BEACON_ID}
    assert {sample.peer for sample in theirs} == {UAV_ID}
    assert {sample.frame for sample in ours} == {sample.frame for sample in theirs}
    assert ours[0].csi.shape == (30, 3)
    radio.skip_to(0.9)
    later = radio.samples(1.0, standing(_UAV_M, 0.0, 1.0), standing(_BEACON_M, 0.0, 1.0))
    assert min(sample.t_mono_ns for is_ours, sample in later if is_ours) > 0.89 * NS_PER_S


def test_a_worker_answers_when_its_time_has_come_and_once() -> None:
    clock = ManualClock(0)
    worker = InlineWorker("bartlett", clock)
    t_s = np.linspace(0.0, 1.0, 60)
    aperture = Aperture(
        t_s=t_s, chi_m=0.3 * np.stack([np.cos(5 * t_s), np.sin(5 * t_s), t_s], axis=1), channel=np.exp(9j * t_s),
        wavelength_m=0.054, reference_p_m=(0.0, 0.0, 0.0), reference_t_s=0.5,
    )  # fmt: skip
    assert [worker.submit(2, aperture), worker.submit(2, aperture)] == [0, 1]
    assert worker.due(0) == []
    assert [(one.id, one.peer, one.estimate is not None) for one in worker.due(NS_PER_S)] == [
        (0, 2, True),
        (1, 2, True),
    ]
    assert worker.due(2 * NS_PER_S) == []
