"""What the tag camera is to the flight: its frames joined with our own pose, judged, and asked for at each tick."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from typing import Any, Final

from companion.camera.place import Mounting
from companion.camera.sighting import Tag, TagFrame
from companion.config.schema import Config
from companion.core.clock import NS_PER_S, age_s
from companion.core.event_clock import EventClock
from companion.core.messages import Pose, Quaternion, Vector3, VehicleState
from companion.core.recorder import Recorder
from companion.core.streams import TAG_PLACE
from companion.flight.records import TagReport
from companion.guidance.camera_target import CameraPlace, CameraTargets, Doubt, doubt
from companion.guidance.steering import Aim
from companion.guidance.target import Target
from companion.neighbours.neighbour import Neighbour

_POSES: Final = 400
_PLACES: Final = 40
_ATTITUDE_NS: Final = NS_PER_S // 20
"""An attitude that is farther in time from an image is not that of the image,"""
_PLACE_NS: Final = NS_PER_S // 4
"""nor is a place, which the autopilot tells with a velocity."""
_ROBOT_S: Final = 1.0
_NEAR_S: Final = 1.0
"""So long the camera must see the robot within the range of arrival."""


class CameraLead:
    """`radio` is what the radio says of a robot. Frames come in at `take`; who asks for a place gets one only while
    the camera leads."""

    def __init__(
        self,
        *,
        config: Config,
        clock: EventClock,
        recorder: Recorder,
        neighbours: Mapping[int, Neighbour],
        radio: Callable[[int], Target | None],
    ) -> None:
        camera = config.tag_camera
        self._clock = clock
        self._recorder = recorder
        self._neighbours = neighbours
        self._radio = radio
        self._family = camera.family
        self._peers = {tag.tag: tag.peer for tag in camera.tags}
        self._max_range_m = camera.max_range_m
        yaw, pitch, roll = (math.radians(angle) for angle in (camera.yaw_deg, camera.pitch_deg, camera.roll_deg))
        self._mounting = Mounting(camera.position_m, yaw, pitch, roll)
        self._arrival_m = config.mission.arrival_range_m
        self._confidence = config.mission.arrival_confidence
        self._targets = CameraTargets()
        self._attitudes: deque[tuple[int, Quaternion]] = deque(maxlen=_POSES)
        self._places: deque[tuple[int, Vector3, Vector3]] = deque(maxlen=_PLACES)
        self._frame_ns: int | None = None
        self._near_ns: int | None = None
        self.counts = Counter[str]()
        """Frames, tags of other robots, sightings that were believed, and those that were not by their reasons."""

    def add_pose(self, pose: Pose) -> None:
        """Of our body, North-aligned."""
        self._attitudes.append((pose.t_mono_ns, pose.q_enu_from_body))

    def follow(self, vehicle: VehicleState) -> None:
        """At each tick."""
        t_ns, p_m = vehicle.position_mono_ns, vehicle.p_local_enu_m
        if t_ns is not None and p_m is not None and (not self._places or t_ns > self._places[-1][0]):
            self._places.append((t_ns, p_m, vehicle.v_local_enu_m_s or (0.0, 0.0, 0.0)))

    def shift(self, delta_enu_m: Vector3) -> None:
        """The autopilot's local frame was set anew."""
        self._targets.shift(delta_enu_m)
        self._places.clear()

    def begin_anew(self) -> None:
        """A mission begins."""
        self._targets.forget()
        self._near_ns = None

    def select(self) -> None:
        """Another robot is the target. Where all of them are seen stays: the one before is to be kept clear of."""
        self._near_ns = None

    def take(self, frame: TagFrame) -> None:
        """What the camera's process tells of one image."""
        self._frame_ns = self._clock.now_ns()
        self.counts["frames"] += 1
        for tag in frame.tags:
            peer = self._peers.get(tag.id) if frame.family == self._family else None
            if peer is None or peer not in self._neighbours:
                self.counts["other tags"] += 1
                continue
            self._judge(peer, tag, frame.t_mono_ns)

    def place(self, peer: int) -> CameraPlace | None:
        """None while the camera does not lead to that robot."""
        place = self._targets.place(peer, self._clock.now_ns())
        newest = self._neighbours[peer].newest_pose()
        return place if place is not None and newest is not None and newest[0] == place.boot else None

    def where(self, peer: int) -> Vector3 | None:
        """Where that robot has come to, by the camera and by its own poses since; in the autopilot's local frame."""
        place, newest = self.place(peer), self._neighbours[peer].newest_pose()
        return None if place is None or newest is None else place.place(newest[1])

    def known_places(self, besides: int | None = None) -> tuple[Vector3, ...]:
        """Of all robots that the camera sees, but for one."""
        seen = (self.where(peer) for peer in self._peers.values() if peer != besides)
        return tuple(place for place in seen if place is not None)

    def aim(self, peer: int, p_m: Vector3) -> Aim | None:
        """Where that robot is from a place; None while the camera does not lead."""
        place, where_m = self.place(peer), self.where(peer)
        if place is None or where_m is None:
            return None
        east, north, up = (there - here for there, here in zip(where_m, p_m, strict=True))
        (xx, _, _), (_, yy, _), _ = place.covariance_m2
        return Aim(
            azimuth_rad=math.atan2(north, east),
            distance_m=math.hypot(east, north),
            distance_std_m=math.sqrt(max(xx, yy)),
            sureness=1.0,
            above_m=up,
        )

    def is_near(self, peer: int, p_m: Vector3) -> bool | None:
        """At each tick: whether that robot is within the range of arrival, surely and for a while; None while the
        camera does not lead."""
        place, newest = self.place(peer), self._neighbours[peer].newest_pose()
        if place is None or newest is None:
            self._near_ns = None
            return None
        if place.within(p_m, newest[1], self._arrival_m) < self._confidence:
            self._near_ns = None
            return False
        now_ns = self._clock.now_ns()
        self._near_ns = now_ns if self._near_ns is None else self._near_ns
        return age_s(self._near_ns, now_ns) >= _NEAR_S

    def status(self, peer: int) -> dict[str, Any]:
        """For a person; `leads` says who leads to that robot."""
        age = age_s(self._frame_ns, self._clock.now_ns())
        return {
            "leads": "radio" if self.place(peer) is None else "camera",
            "frame_age_s": age if math.isfinite(age) else None,
            **dict(self.counts),
        }

    def _judge(self, peer: int, tag: Tag, t_ns: int) -> None:
        why, p_m = self._believed(peer, tag, t_ns)
        self.counts["believed" if why is None else str(why)] += 1
        leads = self._targets.place(peer, self._clock.now_ns()) is not None
        report = TagReport(
            t_mono_ns=t_ns, peer=peer, doubt="" if why is None else str(why), p_local_enu_m=p_m, leads=leads
        )
        self._recorder.record(TAG_PLACE, t_ns, report)

    def _believed(self, peer: int, tag: Tag, t_ns: int) -> tuple[Doubt | None, Vector3 | None]:
        """Why not, and where the tag was seen."""
        why = doubt(tag, self._max_range_m)
        if why is not None:
            return why, None
        attitude, own_m = self._attitude(t_ns), self._own_place(t_ns)
        if attitude is None or own_m is None:
            return Doubt.POSE, None
        seen = self._mounting.place(tag, own_m, attitude)
        x, y, z = seen.p_local_enu_m.tolist()
        robot = self._neighbours[peer]
        newest = robot.newest_pose()
        if newest is None or age_s(robot.heard_ns, self._clock.now_ns()) > _ROBOT_S:
            return Doubt.ROBOT, (x, y, z)
        return self._targets.add(peer, t_ns, seen, own_m, robot=newest, radio=self._radio(peer)), (x, y, z)

    def _attitude(self, t_ns: int) -> Quaternion | None:
        """Ours at a time; None where none is known near it."""
        near = min(self._attitudes, key=lambda one: abs(one[0] - t_ns), default=None)
        return None if near is None or abs(near[0] - t_ns) > _ATTITUDE_NS else near[1]

    def _own_place(self, t_ns: int) -> Vector3 | None:
        near = min(self._places, key=lambda one: abs(one[0] - t_ns), default=None)
        if near is None or abs(near[0] - t_ns) > _PLACE_NS:
            return None
        dt_s = (t_ns - near[0]) / NS_PER_S
        x, y, z = (p + v * dt_s for p, v in zip(near[1], near[2], strict=True))
        return x, y, z
