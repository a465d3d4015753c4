"""Frames of the tag camera joined with our own pose: where the robot is, how old that is, and who leads."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from companion.camera.sighting import Tag, TagFrame
from companion.config.file import load_config
from companion.config.tag_camera import PeerTag, TagCameraConfig
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.messages import Pose, Vector3, VehicleState
from companion.flight.camera_lead import CameraLead
from companion.flight.records import TagReport
from companion.guidance.camera_target import Doubt
from companion.neighbours.neighbour import Neighbour
from tests.kept import Kept
from tests.manual_clock import ManualClock
from tests.paths import CONFIGS
from tests.unit.companion.camera.tags import TAG
from tests.unit.companion.guidance.test_camera_target import _radio

_PEER, _OTHER, _BOOT = 2, 3, 11
_NOW_NS = 100 * NS_PER_S
_LEVEL = (1.0, 0.0, 0.0, 0.0)
_ROBOT_M: Vector3 = (4.0, 0.0, 0.0)
_CONFIG = replace(
    load_config(CONFIGS / "uav.yaml"),
    tag_camera=TagCameraConfig(
        enabled=True, tags=[PeerTag(peer=_PEER, tag=7, size_m=0.16), PeerTag(peer=_OTHER, tag=8, size_m=0.16)]
    ),
)


class _Robot(Neighbour):
    """Heard all the time; its own poses begin where it stands."""

    def newest_pose(self) -> tuple[int, Vector3] | None:
        return _BOOT, (0.0, 0.0, 0.0)


class _Flown:
    """A vehicle that flies East at 0.5 m/s and looks East, to a robot that stands 4 m from where it began."""

    def __init__(self) -> None:
        self.clock, self.kept = ManualClock(_NOW_NS), Kept()
        self.robots = {peer: _Robot(peer, str(peer)) for peer in (_PEER, _OTHER)}
        radio = replace(_radio(_ROBOT_M), boot=_BOOT)
        self.lead = CameraLead(
            config=_CONFIG,
            clock=EventClock(self.clock),
            recorder=self.kept,
            neighbours=self.robots,
            radio=lambda peer: radio,
        )
        self.x_m = 0.0

    def fly(self, seconds: float, tag: Tag = TAG, late_s: float = 0.04, family: str = "tag36h11") -> None:
        for _ in range(round(seconds * 10)):
            self.clock.advance(0.1)
            self.x_m += 0.05
            now_ns = self.clock.now_ns()
            for robot in self.robots.values():
                robot.heard_ns = now_ns
            v: Vector3 = (0.5, 0.0, 0.0)
            self.lead.add_pose(
                Pose(t_mono_ns=now_ns, p_enu_m=(0.0, 0.0, 0.0), q_enu_from_body=_LEVEL, v_enu_m_s=v, confidence=3)
            )
            self.lead.follow(
                VehicleState(
                    t_mono_ns=now_ns, position_mono_ns=now_ns, p_local_enu_m=(self.x_m, 0.0, 0.0), v_local_enu_m_s=v
                )
            )
            seen_m = _ROBOT_M[0] - (self.x_m - 0.5 * late_s)
            shown = replace(tag, p_camera_m=(0.0, 0.0, seen_m), other_p_camera_m=(0.0, 0.0, seen_m))
            t_ns = now_ns - round(late_s * NS_PER_S)
            self.lead.take(TagFrame(t_mono_ns=t_ns, family=family, tags=(shown,)))

    @property
    def reports(self) -> list[TagReport]:
        return [message for _, _, message in self.kept.messages]


def test_the_place_is_that_at_the_time_of_the_image() -> None:
    flown = _Flown()
    assert flown.lead.status(_PEER) == {"leads": "radio", "frame_age_s": None}
    flown.fly(0.5)
    where_m = flown.lead.where(_PEER)
    assert where_m is not None
    np.testing.assert_allclose(where_m, _ROBOT_M, atol=1e-6)
    aim = flown.lead.aim(_PEER, (flown.x_m, 0.0, 1.0))
    assert aim is not None
    assert aim.distance_m == pytest.approx(4.0 - flown.x_m, abs=1e-6)
    assert (aim.azimuth_rad, aim.above_m, aim.sureness) == pytest.approx((0.0, -1.0, 1.0), abs=1e-6)
    assert aim.distance_std_m < 0.2
    assert flown.lead.status(_PEER) == {"leads": "camera", "frame_age_s": 0.0, "frames": 5, "believed": 5}
    assert [report.leads for report in flown.reports] == [False, False, True, True, True]
    assert flown.lead.known_places() == (where_m,) and flown.lead.known_places(besides=_PEER) == ()
    assert flown.lead.place(_OTHER) is None


def test_it_ends_when_no_image_comes() -> None:
    flown = _Flown()
    flown.fly(0.5)
    flown.clock.advance(0.5)
    assert flown.lead.aim(_PEER, (0.0, 0.0, 0.0)) is None and flown.lead.is_near(_PEER, _ROBOT_M) is None
    assert flown.lead.status(_PEER)["leads"] == "radio"


@pytest.mark.parametrize(
    ("values", "counted"),
    [
        ({"tag": replace(TAG, id=9)}, "other tags"),
        ({"family": "tag25h9"}, "other tags"),
        ({"tag": replace(TAG, margin=0.1)}, Doubt.BITS),
        ({"late_s": 5.0}, Doubt.POSE),
        ({"late_s": -0.1}, Doubt.POSE),
    ],
)
def test_what_cannot_be_placed_is_counted_by_its_reason(values: dict[str, object], counted: str) -> None:
    flown = _Flown()
    flown.fly(1.0, **values)  # type: ignore[arg-type]
    told = flown.lead.status(_PEER)
    assert told["leads"] == "radio" and told[str(counted)] >= 9 and "believed" not in told
    assert {report.doubt for report in flown.reports} <= {str(counted)}


def test_a_robot_that_is_not_heard_has_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    flown = _Flown()
    monkeypatch.setattr(_Robot, "newest_pose", lambda self: None)
    flown.fly(0.5)
    assert flown.lead.status(_PEER)[str(Doubt.ROBOT)] == 5


def test_it_is_near_after_a_second_within_the_range_of_arrival() -> None:
    flown = _Flown()
    flown.fly(1.0)
    far: Vector3 = (0.5, 0.0, 0.0)
    assert flown.lead.is_near(_PEER, far) is False
    near: Vector3 = (2.5, 0.0, 0.0)
    for expected in (False, False, True):
        assert flown.lead.is_near(_PEER, near) is expected
        flown.fly(0.5)
    assert flown.lead.is_near(_PEER, far) is False
    assert flown.lead.is_near(_PEER, near) is False, "it begins anew"


def test_another_frame_or_another_mission_leaves_nothing_behind() -> None:
    flown = _Flown()
    flown.fly(0.5)
    flown.lead.shift((1.0, 0.0, 0.0))
    where_m = flown.lead.where(_PEER)
    assert where_m is not None and where_m[0] == pytest.approx(5.0)
    flown.lead.begin_anew()
    assert flown.lead.where(_PEER) is None


def test_another_target_is_not_near_by_the_one_before_which_is_kept_clear_of_all_the_same() -> None:
    flown = _Flown()
    flown.fly(1.0)
    near: Vector3 = (2.5, 0.0, 0.0)
    assert flown.lead.is_near(_PEER, near) is False
    flown.fly(1.0)
    where_m = flown.lead.where(_PEER)
    assert where_m is not None and flown.lead.is_near(_PEER, near) is True
    flown.lead.select()
    assert flown.lead.known_places(besides=_OTHER) == (where_m,)
    assert flown.lead.is_near(_PEER, near) is False, "it begins anew"


def test_the_same_frames_are_judged_the_same() -> None:
    first, second = _Flown(), _Flown()
    for flown in (first, second):
        flown.fly(1.0)
        flown.fly(0.2, tag=replace(TAG, hamming=2))
        flown.fly(1.0)
    assert first.reports == second.reports and len(first.reports) == 22
    assert math.isclose(first.x_m, second.x_m)
