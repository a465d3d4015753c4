"""A log in which the tag camera sees the robot: a replay of it is that flight again, what it saw to the byte."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import msgspec
import numpy as np
import pytest

from companion.camera import sighting
from companion.camera.sighting import TagFrame
from companion.config.schema import Config
from companion.config.tag_camera import PeerTag, TagCameraConfig
from companion.core.messages import VehicleState, pose_of
from companion.core.streams import POSE_IN, PROFILE, SETPOINT, TAG, TAG_PLACE, VEHICLE
from companion.log.reader import LoggedMessage, Session
from companion.replay.player import INPUT_TOPICS
from tests.golden.golden_logs import GOLDEN, replayed_as
from tests.unit.companion.camera.tags import TAG as SEEN
from wsr.geometry import quaternion_conjugate, rotate

_AWAY_M = np.array([3.0, 0.4, -0.3])
"""Of the tag from where the vehicle is at the first image; ENU."""
_EVERY_NS = 100_000_000
_SHOWN_NS = 2_500_000_000


class _Changed(Session):
    """A golden log with a camera in its configuration, that looks East and sees a tag standing still from the middle of
    the log on."""

    def config(self) -> Config:
        config = super().config()
        tag = PeerTag(peer=config.target, tag=SEEN.id, size_m=0.16)
        return dataclasses.replace(config, tag_camera=TagCameraConfig(enabled=True, tags=[tag], max_range_m=20.0))

    def messages(self, *asked: object, **others: object) -> Iterator[LoggedMessage]:
        kept = list(super().messages(INPUT_TOPICS))
        middle_ns, next_ns, shift = (kept[0].log_time_ns + kept[-1].log_time_ns) // 2, 0, 0
        place_m: Any = None
        own_m: Any = None
        for message in kept:
            if message.log_time_ns > middle_ns + _SHOWN_NS:
                return
            yield dataclasses.replace(message, sequence=message.sequence + shift)
            if message.topic == VEHICLE.topic:
                own_m = msgspec.json.decode(message.data, type=VehicleState).p_local_enu_m
            if message.topic != POSE_IN.topic or own_m is None or message.log_time_ns < max(middle_ns, next_ns):
                continue
            next_ns = message.log_time_ns + _EVERY_NS
            pose = pose_of(message.data)
            place_m = np.array(own_m) + _AWAY_M if place_m is None else place_m
            ahead, left, up = rotate(quaternion_conjugate(pose.q_enu_from_body), place_m - own_m).tolist()
            seen = dataclasses.replace(SEEN, p_camera_m=(-left, -up, ahead), other_p_camera_m=(-left, -up, ahead))
            frame = TagFrame(t_mono_ns=pose.t_mono_ns, family="tag36h11", tags=(seen,))
            shift += 1
            yield LoggedMessage(
                topic=TAG.topic, log_time_ns=message.log_time_ns, data=sighting.encode(frame),
                sequence=message.sequence + shift,
            )  # fmt: skip


@pytest.mark.long
def test_what_the_camera_saw_is_replayed_to_the_byte() -> None:
    (path,) = GOLDEN
    first, second = replayed_as(_Changed, path), replayed_as(_Changed, path)
    seen = [[(one.event, one.data) for one in replay.decided if one.stream is TAG_PLACE] for replay in (first, second)]
    assert seen[0] == seen[1]
    places = [msgspec.json.decode(data) for _, data in seen[0]]
    assert len(places) > 20 and places[-1]["leads"] and not places[0]["leads"]
    steps, again = (
        [(one.stream.topic, one.event) for one in replay.decided if one.stream.topic != PROFILE.topic]
        for replay in (first, second)
    )
    assert steps == again
    v_m_s = [
        np.array([msgspec.json.decode(one.data)["v_local_enu_m_s"] for one in replay.decided if one.stream is SETPOINT])
        for replay in (first, second)
    ]
    np.testing.assert_allclose(v_m_s[0], v_m_s[1], atol=1e-6)
