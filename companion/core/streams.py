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


@dataclass(frozen=True, slots=True)
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

CSI: Final = Stream("/csi", 150, 2.0, "raw", _IN)
POSE_IN: Final = Stream("/pose/in", 200, 0.2, "raw", _IN)
NEIGHBOUR: Final = Stream("/neighbour", 10, 2.0, "raw", _IN)
TICK: Final = Stream("/tick", 20, 0.2, "json", _IN)
VEHICLE: Final = Stream("/vehicle", 20, 1.5, "json", _IN)
WISH: Final = Stream("/wish", 0, 0.0, "json", _IN)
COMMAND: Final = Stream("/command", 0, 0.0, "json", _IN)
WORKER: Final = Stream("/aoa/worker", 0, 0.0, "json", _IN)
ANSWER: Final = Stream("/aoa/answer", 0.3, 20.0, "json", _IN)
SECOND: Final = Stream("/second", 1, 3.0, "json", _IN)
SURROUNDINGS: Final = Stream("/surroundings", 0, 0.0, "json", _IN)
BOOK: Final = Stream("/book", 0, 0.0, "json", _IN)
END: Final = Stream("/end", 0, 0.0, "json", _IN)
TAG: Final = Stream("/tag", 0, 0.0, "json", _IN)

APERTURE: Final = Stream("/aperture", 0.3, 20.0, "msgpack", _DECIDED)
BEARING: Final = Stream("/bearing", 0.3, 20.0, "json", _DECIDED)
TARGET: Final = Stream("/target", 0.3, 20.0, "json", _DECIDED)
MISSION: Final = Stream("/mission", 0, 0.0, "json", _DECIDED)
SETPOINT: Final = Stream("/setpoint", 20, 0.2, "json", _DECIDED)
GATE: Final = Stream("/gate", 0, 0.0, "json", _DECIDED)
OBSERVED: Final = Stream("/observed_setpoint", 0, 0.0, "json", _DECIDED)
TAG_PLACE: Final = Stream("/tag/place", 0, 0.0, "json", _DECIDED)

PROFILE: Final = Stream("/aoa/profile", 0.3, 20.0, "protobuf", _VIEW)
POSE: Final = Stream("/pose", 50, 0.2, "protobuf", _VIEW)
APERTURE_PATH: Final = Stream("/aperture/path", 0.3, 20.0, "protobuf", _VIEW)
TRANSFORMS: Final = Stream("/tf", 20, 0.5, "protobuf", _VIEW)
SCENE: Final = Stream("/scene", 0.3, 20.0, "protobuf", _VIEW)

TEAM: Final = Stream("/team", 0, 0.0, "json", _REPORT)
HEALTH: Final = Stream("/health", 1, 3.0, "json", _REPORT)
LOG: Final = Stream("/log", 0, 0.0, "protobuf", _REPORT)
AUTOPILOT_EVENT: Final = Stream("/autopilot_event", 0, 0.0, "json", _REPORT)

TRUTH: Final = Stream("/truth", 20, 0.5, "json", Part.TRUTH)

STREAMS: Final = (
    CSI, POSE_IN, NEIGHBOUR, TICK, VEHICLE, WISH, COMMAND, WORKER, ANSWER, SECOND, SURROUNDINGS, BOOK, END, TAG,
    APERTURE, BEARING, TARGET, MISSION, SETPOINT, GATE, OBSERVED, TAG_PLACE,
    PROFILE, POSE, APERTURE_PATH, TRANSFORMS, SCENE,
    TEAM, HEALTH, LOG, AUTOPILOT_EVENT, TRUTH,
)  # fmt: skip
