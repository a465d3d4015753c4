"""One table of all that flows through the service: what it is called in the log, how often, and when it is stale."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final


class Part(StrEnum):
    """What a stream is to a replay."""

    INPUT = "input"
    """Given to the service: the whole of these, in their order, decides everything else."""
    DECISION = "decision"
    """Made by the service from its inputs: a replay makes it again and compares."""
    VIEW = "view"
    """Drawn from other streams for viewers, in schemas that they know."""
    REPORT = "report"
    """What the service says of itself; depends on the machine."""
    TRUTH = "truth"
    """What really was, where a simulator or motion capture knows it. The service never sees it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Stream:
    """`rate_hz` is what a healthy system delivers; `stale_s` after the newest message the stream counts as lost."""

    topic: str
    rate_hz: float
    stale_s: float
    encoding: str
    """Message encoding in the log: "json" (with a JSON schema), "protobuf" (Foxglove's), "msgpack" or "raw" (bytes as
    received)."""
    part: Part


_IN, _DECIDED, _VIEW, _REPORT = Part.INPUT, Part.DECISION, Part.VIEW, Part.REPORT

CSI: Final = Stream(topic="/csi", rate_hz=150, stale_s=2.0, encoding="raw", part=_IN)
POSE_IN: Final = Stream(topic="/pose/in", rate_hz=200, stale_s=0.2, encoding="raw", part=_IN)
NEIGHBOUR: Final = Stream(topic="/neighbour", rate_hz=10, stale_s=2.0, encoding="raw", part=_IN)
TICK: Final = Stream(topic="/tick", rate_hz=20, stale_s=0.2, encoding="json", part=_IN)
VEHICLE: Final = Stream(topic="/vehicle", rate_hz=20, stale_s=1.5, encoding="json", part=_IN)
WISH: Final = Stream(topic="/wish", rate_hz=0, stale_s=0.0, encoding="json", part=_IN)
COMMAND: Final = Stream(topic="/command", rate_hz=0, stale_s=0.0, encoding="json", part=_IN)
WORKER: Final = Stream(topic="/aoa/worker", rate_hz=0, stale_s=0.0, encoding="json", part=_IN)
ANSWER: Final = Stream(topic="/aoa/answer", rate_hz=2, stale_s=20.0, encoding="json", part=_IN)
SECOND: Final = Stream(topic="/second", rate_hz=1, stale_s=3.0, encoding="json", part=_IN)
SURROUNDINGS: Final = Stream(topic="/surroundings", rate_hz=0, stale_s=0.0, encoding="json", part=_IN)
BOOK: Final = Stream(topic="/book", rate_hz=0, stale_s=0.0, encoding="json", part=_IN)
END: Final = Stream(topic="/end", rate_hz=0, stale_s=0.0, encoding="json", part=_IN)
TAG: Final = Stream(topic="/tag", rate_hz=0, stale_s=0.0, encoding="json", part=_IN)

APERTURE: Final = Stream(topic="/aperture", rate_hz=2, stale_s=20.0, encoding="msgpack", part=_DECIDED)
BEARING: Final = Stream(topic="/bearing", rate_hz=2, stale_s=20.0, encoding="json", part=_DECIDED)
TARGET: Final = Stream(topic="/target", rate_hz=2, stale_s=20.0, encoding="json", part=_DECIDED)
MISSION: Final = Stream(topic="/mission", rate_hz=0, stale_s=0.0, encoding="json", part=_DECIDED)
SETPOINT: Final = Stream(topic="/setpoint", rate_hz=20, stale_s=0.2, encoding="json", part=_DECIDED)
GATE: Final = Stream(topic="/gate", rate_hz=0, stale_s=0.0, encoding="json", part=_DECIDED)
OBSERVED: Final = Stream(topic="/observed_setpoint", rate_hz=0, stale_s=0.0, encoding="json", part=_DECIDED)
TAG_PLACE: Final = Stream(topic="/tag/place", rate_hz=0, stale_s=0.0, encoding="json", part=_DECIDED)

PROFILE: Final = Stream(topic="/aoa/profile", rate_hz=2, stale_s=20.0, encoding="protobuf", part=_VIEW)
POSE: Final = Stream(topic="/pose", rate_hz=50, stale_s=0.2, encoding="protobuf", part=_VIEW)
APERTURE_PATH: Final = Stream(topic="/aperture/path", rate_hz=2, stale_s=20.0, encoding="protobuf", part=_VIEW)
TRANSFORMS: Final = Stream(topic="/tf", rate_hz=20, stale_s=0.5, encoding="protobuf", part=_VIEW)
SCENE: Final = Stream(topic="/scene", rate_hz=2, stale_s=20.0, encoding="protobuf", part=_VIEW)

TEAM: Final = Stream(topic="/team", rate_hz=0, stale_s=0.0, encoding="json", part=_REPORT)
HEALTH: Final = Stream(topic="/health", rate_hz=1, stale_s=3.0, encoding="json", part=_REPORT)
LOG: Final = Stream(topic="/log", rate_hz=0, stale_s=0.0, encoding="protobuf", part=_REPORT)
AUTOPILOT_EVENT: Final = Stream(topic="/autopilot_event", rate_hz=0, stale_s=0.0, encoding="json", part=_REPORT)

TRUTH: Final = Stream(topic="/truth", rate_hz=20, stale_s=0.5, encoding="json", part=Part.TRUTH)

STREAMS: Final = (
    CSI, POSE_IN, NEIGHBOUR, TICK, VEHICLE, WISH, COMMAND, WORKER, ANSWER, SECOND, SURROUNDINGS, BOOK, END, TAG,
    APERTURE, BEARING, TARGET, MISSION, SETPOINT, GATE, OBSERVED, TAG_PLACE,
    PROFILE, POSE, APERTURE_PATH, TRANSFORMS, SCENE,
    TEAM, HEALTH, LOG, AUTOPILOT_EVENT, TRUTH,
)  # fmt: skip
