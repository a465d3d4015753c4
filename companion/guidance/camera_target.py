"""Where the camera sees a robot: which sightings are believed, and what they say together. Pure, but for its memory.

A robot's place is kept as the radio's belief keeps it: as the origin of the robot's own poses in our local frame, so
that a robot that drives is one that stands. One sighting moves nothing: the camera leads when several agree with each
other, and either with what the radio says or from places of our own that differ.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.camera.place import TagPlace
from companion.camera.sighting import Tag
from companion.core.clock import age_s
from companion.core.messages import Vector3
from companion.guidance.target import Target
from wsr.aoa import Matrix3

FRESH_S: Final = 0.5
"""So long after its newest sighting that was believed the camera leads."""
MAX_HAMMING: Final = 1
MIN_MARGIN: Final = 0.25
MIN_CONTRAST: Final = 0.1
MAX_ERROR_PX: Final = 0.5
"""docs/camera.md has what tags that are seen well and badly give."""
AGREES: Final = 16.3
"""Of a squared normalised innovation in three dimensions: 0.1 % of what is true lies beyond."""
_WITH_RADIO: Final = 3
"""Sightings that agree with the radio and with each other, for the camera to lead;"""
_ALONE: Final = 8
"""and where the radio does not say so,"""
_APART_M: Final = 0.5
"""from places of ours that are so far apart."""
_WINDOW_S: Final = 3.0
"""Within which these must lie."""
_WALK_M2_S: Final = 0.05**2
"""Both robots' poses drift against each other."""
_Floats = npt.NDArray[np.float64]


class Doubt(StrEnum):
    """Why a sighting is not believed."""

    BITS = "its code is read doubtfully"
    EDGES = "its edges do not fit a square"
    RANGE = "farther than tag_camera.max_range_m"
    POSE = "no pose of ours at that time"
    ROBOT = "the robot's own poses are not known"
    TRACK = "not where the tag was seen before"


def doubt(tag: Tag, max_range_m: float) -> Doubt | None:
    """By what the image alone says."""
    if tag.hamming > MAX_HAMMING or tag.margin < MIN_MARGIN or tag.contrast < MIN_CONTRAST:
        return Doubt.BITS
    if tag.error_px > MAX_ERROR_PX:
        return Doubt.EDGES
    if math.hypot(*tag.p_camera_m) > max_range_m:
        return Doubt.RANGE
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraPlace:
    """What the sightings of a robot say together: the origin of its own poses in the autopilot's local frame."""

    t_mono_ns: int
    """Of the newest."""
    boot: int
    origin_local_enu_m: Vector3
    covariance_m2: Matrix3

    def place(self, target_p_enu_m: Vector3) -> Vector3:
        """Where the robot is in that frame when its own poses say `target_p_enu_m`."""
        x, y, z = (o + q for o, q in zip(self.origin_local_enu_m, target_p_enu_m, strict=True))
        return x, y, z

    def within(self, p_m: Vector3, target_p_enu_m: Vector3, range_m: float) -> float:
        """The probability that the robot is within a range of a place, by the deviation along the line between."""
        line_m = np.array(self.place(target_p_enu_m)) - p_m
        distance_m = float(np.linalg.norm(line_m))
        along = line_m / distance_m if distance_m > 1e-6 else np.array([1.0, 0.0, 0.0])
        std_m = math.sqrt(float(along @ np.array(self.covariance_m2) @ along))
        return 0.5 * (1.0 + math.erf((range_m - distance_m) / (math.sqrt(2.0) * std_m)))


@dataclass(frozen=True, slots=True)
class _Seen:
    t_ns: int
    own_m: _Floats
    """Where we were."""
    agrees: bool
    """With the radio."""


@dataclass(slots=True, kw_only=True)
class _Track:
    boot: int
    t_ns: int
    mean_m: _Floats
    corners_m2: _Floats
    """Of the mean, by what is new with each image."""
    shared_m2: _Floats
    """Of the newest sighting, what averaging does not take away."""
    seen: deque[_Seen] = field(default_factory=lambda: deque(maxlen=64))
    leads: bool = False


class CameraTargets:
    """One track for each robot whose tag was seen."""

    def __init__(self) -> None:
        self._tracks: dict[int, _Track] = {}

    def forget(self) -> None:
        """A mission begins."""
        self._tracks.clear()

    def shift(self, delta_enu_m: Vector3) -> None:
        """The autopilot's local frame was set anew: all places in it are `delta_enu_m` elsewhere."""
        for track in self._tracks.values():
            track.mean_m = track.mean_m + delta_enu_m
            moved = [_Seen(one.t_ns, one.own_m + delta_enu_m, one.agrees) for one in track.seen]
            track.seen.clear()
            track.seen.extend(moved)

    def add(
        self, peer: int, t_ns: int, seen: TagPlace, own_m: Vector3, *, robot: tuple[int, Vector3], radio: Target | None
    ) -> Doubt | None:
        """A sighting that the image does not make doubtful; why it is not believed. `own_m` is where we were, `robot`
        the boot and the place of the robot by its own poses, `radio` what the radio says of it."""
        boot, robot_m = robot
        origin_m = seen.p_local_enu_m - robot_m
        track = self._tracks.get(peer)
        if track is None or track.boot != boot or age_s(track.t_ns, t_ns) > FRESH_S or t_ns < track.t_ns:
            track = None
        if track is None:
            shared_m2 = seen.covariance_m2 - seen.corners_m2
            self._tracks[peer] = track = _Track(
                boot=boot, t_ns=t_ns, mean_m=origin_m, corners_m2=seen.corners_m2, shared_m2=shared_m2
            )
        elif not self._update(track, t_ns, origin_m, seen):
            return Doubt.TRACK
        agrees = radio is not None and radio.boot == boot and _agrees(origin_m, seen.covariance_m2, radio)
        track.seen.append(_Seen(t_ns, np.array(own_m), agrees))
        while age_s(track.seen[0].t_ns, t_ns) > _WINDOW_S:
            track.seen.popleft()
        track.leads = track.leads or _is_confirmed(track.seen)
        return None

    def place(self, peer: int, now_ns: int) -> CameraPlace | None:
        """Where the camera sees a robot; None while it does not lead."""
        track = self._tracks.get(peer)
        if track is None or not track.leads or age_s(track.t_ns, now_ns) > FRESH_S:
            return None
        x, y, z = track.mean_m.tolist()
        a, b, c = (tuple(row) for row in (track.corners_m2 + track.shared_m2).tolist())
        return CameraPlace(t_mono_ns=track.t_ns, boot=track.boot, origin_local_enu_m=(x, y, z), covariance_m2=(a, b, c))

    @staticmethod
    def _update(track: _Track, t_ns: int, origin_m: _Floats, seen: TagPlace) -> bool:
        """The track with one sighting more, which must be where it can be."""
        before = track.corners_m2 + np.eye(3) * _WALK_M2_S * age_s(track.t_ns, t_ns)
        innovation_m = origin_m - track.mean_m
        whole = before + track.shared_m2 + seen.covariance_m2
        if innovation_m @ np.linalg.solve(whole, innovation_m) > AGREES:
            return False
        gain = np.linalg.solve((before + seen.corners_m2 + np.eye(3) * 1e-6).T, before.T).T
        track.mean_m = track.mean_m + gain @ innovation_m
        left = np.eye(3) - gain
        track.corners_m2 = left @ before @ left.T + gain @ seen.corners_m2 @ gain.T
        track.shared_m2 = seen.covariance_m2 - seen.corners_m2
        track.t_ns = t_ns
        return True


def _agrees(origin_m: _Floats, covariance_m2: _Floats, radio: Target) -> bool:
    """With the likeliest source, or with all that the radio believes."""
    for mean, covariance in (
        (radio.origin_local_enu_m, radio.covariance_m2),
        (radio.whole.origin_local_enu_m, radio.whole.covariance_m2),
    ):
        away_m = origin_m - mean
        if away_m @ np.linalg.solve(covariance_m2 + np.array(covariance), away_m) <= AGREES:
            return True
    return False


def _is_confirmed(seen: deque[_Seen]) -> bool:
    if sum(one.agrees for one in seen) >= _WITH_RADIO:
        return True
    first_m = np.array([one.own_m for one in seen])
    apart_m = float(np.max(np.linalg.norm(first_m - first_m[-1], axis=1)))
    return len(seen) >= _ALONE and apart_m >= _APART_M
