"""The camera leads the last metres to a tag on the robot, and loses it: the service's own parts and the mock PX4, in
virtual time. Bearings are true to where the robot stands and tell no range, so that the radio alone arrives late."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest

from companion.camera.sighting import Tag, TagFrame
from companion.config.tag_camera import PeerTag, TagCameraConfig
from companion.core.messages import Vector3
from companion.guidance.camera_target import Doubt
from companion.mission.table import State
from companion.sensing.worker_wire import AoaResult
from companion.sim.stage import Stage, set_stage
from tests.faults import virtual_flight
from tests.faults.test_long_mission import _Worker
from tests.faults.virtual_flight import VirtualFlight, noted_setpoints
from wsr.aperture import Aperture

_ROBOT_M: Final[Vector3] = (6.0, 0.0, 0.5)
_TAG: Final = 7
_SEEN_M: Final = 5.0
_FENCE_M: Final = 7.0
_HALF_VIEW: Final = math.tan(math.radians(45.0))
_EVERY: Final = 2
"""Ticks from one image to the next: ten a second."""
_SMALL: Final = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 4e-4))


class _TrueWorker(_Worker):
    flight: VirtualFlight

    def submit(self, peer: int, aperture: Aperture) -> int:
        number = super().submit(peer, aperture)
        result: AoaResult = self.waiting[-1]
        assert result.estimate is not None
        here_m = self.flight.px4.commander.airframe.p_enu_m
        east, north, _ = (there - here for there, here in zip(_ROBOT_M, here_m, strict=True))
        self.waiting[-1] = replace(result, estimate=replace(result.estimate, azimuth_rad=math.atan2(north, east)))
        return number


class _WithCamera(VirtualFlight):
    """The camera looks along the nose, which is East all the time by the poses' attitude."""

    def __init__(self, directory: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(virtual_flight, "set_stage", _stage)
        monkeypatch.setattr(virtual_flight, "_Worker", _TrueWorker)
        super().__init__(directory=directory, out=out, monkeypatch=monkeypatch)
        assert isinstance(self.worker, _TrueWorker)
        self.worker.flight = self
        self.sees = False
        self.shown: Callable[[Tag], Tag] = lambda tag: tag
        self.stands_m = _ROBOT_M
        self.setpoints = noted_setpoints(self, monkeypatch)

    async def tick(self) -> None:
        if self.sees and self._ticks % _EVERY == 0:
            self.look()
        await super().tick()

    def look(self) -> None:
        t_ns = self.clock.now_ns()
        east, north, up = (there - here for there, here in zip(self.stands_m, self.here_m, strict=True))
        in_view = 0.3 < east < _SEEN_M and abs(north) < _HALF_VIEW * east and abs(up) < _HALF_VIEW * east
        place_m = (-north, -up, east)
        tag = Tag(
            id=_TAG, hamming=0, margin=0.8, contrast=0.6, p_camera_m=place_m, covariance_m2=_SMALL, error_px=0.05,
            other_p_camera_m=place_m, other_error_px=1.0,
        )  # fmt: skip
        tags = (self.shown(tag),) if in_view else ()
        self.uav.take_tags(TagFrame(t_mono_ns=t_ns, family="tag36h11", tags=tags))

    @property
    def here_m(self) -> Vector3:
        return self.px4.commander.airframe.p_enu_m

    @property
    def leads(self) -> str:
        return str(self.flight.status()["camera"]["leads"])

    def away_m(self) -> float:
        return math.dist(self.here_m, _ROBOT_M)


def _stage(directory: Path, out: Path, seed: int, use_netlink: bool, gps: bool) -> Stage:
    stage = set_stage(directory, out, seed=seed, use_netlink=use_netlink, gps=gps)
    peer = stage.uav.peers[0].id
    camera = TagCameraConfig(enabled=True, tags=[PeerTag(peer=peer, tag=_TAG, size_m=0.16)])
    gate = replace(stage.uav.gate, fence_max_m=(_FENCE_M, *stage.uav.gate.fence_max_m[1:]))
    return replace(stage, uav=replace(stage.uav, tag_camera=camera, gate=gate))


@pytest.fixture
async def flight(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[_WithCamera]:
    flown = _WithCamera(tmp_path_factory.mktemp("v"), tmp_path, monkeypatch)
    try:
        async with flown.flight._commands:
            await flown.run(2.0)
            yield flown
            flown.flight._commands.cancel()
    finally:
        flown.close()


_SPOILT: Final[dict[str, Callable[[Tag], Tag]]] = {
    "another tag": lambda tag: replace(tag, id=_TAG + 1),
    "bits misread": lambda tag: replace(tag, hamming=2),
    "glare": lambda tag: replace(tag, margin=0.1),
    "crooked": lambda tag: replace(tag, error_px=2.0),
    "too far": lambda tag: replace(tag, p_camera_m=tuple(10 * one for one in tag.p_camera_m)),  # type: ignore[arg-type]
}


async def test_the_camera_leads_where_it_sees_the_right_tag_and_the_vehicle_arrives_by_it(flight: _WithCamera) -> None:
    assert await flight.engage() == ""
    await flight.until(State.APPROACHING)
    await flight.seconds_until(lambda: flight.away_m() < _SEEN_M - 0.3, 60.0)
    # What is not believed changes nothing.
    flight.sees = True
    for flight.shown in _SPOILT.values():
        await flight.run(0.6)
        assert flight.leads == "radio"
    told: dict[str, Any] = flight.flight.status()["camera"]
    assert told["other tags"] > 3 and told[str(Doubt.BITS)] > 6 and "believed" not in told
    # The right tag.
    flight.shown = lambda tag: tag
    await flight.seconds_until(lambda: flight.leads == "camera", 1.0)
    seen_m, estimated_m = flight.flight.knowledge.camera.where(2), flight.state.p_local_enu_m  # type: ignore[union-attr]
    assert seen_m is not None and estimated_m is not None
    from_vehicle_m = np.subtract(seen_m, estimated_m)
    assert np.linalg.norm(from_vehicle_m - np.subtract(_ROBOT_M, flight.here_m)) < 0.3
    assert seen_m in flight.flight.knowledge.places(), "what is seen is kept clear"
    # It is lost, and the radio leads again.
    flight.sees = False
    begun = len(flight.setpoints)
    assert await flight.seconds_until(lambda: flight.leads == "radio", 1.0) <= 0.65
    assert flight.flight.status()["target"] is not None, "its belief went on all the time"
    await flight.run(1.0)
    assert flight.flight.state is State.APPROACHING
    v = np.array([setpoint.v_local_enu_m_s for setpoint in flight.setpoints[begun - 10 :]])
    assert np.linalg.norm(np.diff(v, axis=0), axis=1).max() < 0.1, "nothing jumps at the change"
    # Seen again.
    flight.sees = True
    await flight.until(State.ARRIVED, timeout_s=40.0)
    assert flight.leads == "camera" and flight.away_m() < 2.1
    assert not flight.flight.knowledge.targets.is_near(flight.state.p_local_enu_m or (0.0, 0.0, 0.0)), "the radio alone"


@pytest.mark.long
async def test_the_camera_leads_nowhere_that_the_gate_refuses(
    flight: _WithCamera, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot stands beyond the fence, farther than the range of arrival."""
    flight.stands_m = (_FENCE_M + 3.0, 0.0, 0.5)
    flight.sees = True
    assert await flight.engage() == ""
    await flight.until(State.APPROACHING)
    await flight.seconds_until(lambda: flight.leads == "camera", 90.0)
    await flight.run(20.0)
    assert State.ARRIVED not in flight.states
    assert max(place[0] for setpoint in flight.setpoints if (place := setpoint.p_local_enu_m)) <= _FENCE_M
