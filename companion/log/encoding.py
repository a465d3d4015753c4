"""Messages of the service -> bytes of the log, each with its schema, and the views drawn from them."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator
from typing import Any, Final

import msgspec
import numpy as np
from google.protobuf.message import Message as ProtobufMessage
from mcap_protobuf.schema import build_file_descriptor_set

from companion.core.messages import Pose, VehicleState
from companion.core.streams import APERTURE_PATH, LOG, POSE, PROFILE, SCENE, TRANSFORMS, Stream
from companion.guidance.target import TargetReport
from companion.log import foxglove
from companion.sensing.records import ApertureRecord, Iteration
from wsr.directions import AZIMUTH_RAD, POLAR_RAD

_MAKERS: Final[dict[str, Callable[[int, Any], ProtobufMessage]]] = {
    POSE.topic: foxglove.pose_in_frame,
    PROFILE.topic: lambda t_ns, power: foxglove.grid(
        t_ns, np.frombuffer(power, np.float16).reshape(POLAR_RAD.size, AZIMUTH_RAD.size)
    ),
    LOG.topic: foxglove.log,
}
"""Streams whose messages the service hands over in its own form and the log holds in Foxglove's."""


def encoded(stream: Stream, t_ns: int, message: Any) -> tuple[bytes, Any]:
    """The bytes of a message and what its schema is made from. `t_ns` is wall time."""
    if stream.topic in _MAKERS:
        message = _MAKERS[stream.topic](t_ns, message)
    if isinstance(message, bytes):
        return message, message
    if isinstance(message, ProtobufMessage):
        return message.SerializeToString(deterministic=True), message
    if stream.encoding == "msgpack":
        return msgspec.msgpack.encode(message), message
    return msgspec.json.encode(message), message


def schema_of(message: Any) -> tuple[str, str, bytes]:
    """(name, encoding, schema): of a protobuf message its file descriptors, of a dataclass its JSON schema, nothing for
    raw bytes."""
    if isinstance(message, ProtobufMessage):
        name = message.DESCRIPTOR.full_name
        return name, "protobuf", build_file_descriptor_set(type(message)).SerializeToString(deterministic=True)
    if dataclasses.is_dataclass(message) and not isinstance(message, ApertureRecord):
        return type(message).__name__, "jsonschema", _json_schema(type(message))
    return "", "", b""


def views(
    stream: Stream, t_ns: int, message: Any, pose: Pose | None = None
) -> Iterator[tuple[Stream, ProtobufMessage]]:
    """What a viewer shows of a message. `t_ns` is wall time, `pose` the newest of the pose source."""
    match message:
        case VehicleState():
            if (turns := foxglove.transforms(t_ns, message, pose)) is not None:
                yield TRANSFORMS, turns
        case ApertureRecord():
            yield APERTURE_PATH, foxglove.poses_in_frame(t_ns, message.positions_m())
        case Iteration(estimate=estimate, p_local_enu_m=place) if estimate is not None and place is not None:
            yield SCENE, foxglove.bearing_arrow(t_ns, f"bearing {message.number}", place, estimate)
        case TargetReport(peer=peer, target=target, p_local_enu_m=place) if place is not None:
            yield SCENE, foxglove.target_sphere(t_ns, f"robot {peer}", place, target.range_std_m)
        case _:
            return


def _json_schema(kind: type) -> bytes:
    """The schema of a dataclass with its definitions beside the top level."""
    (schema,), components = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
    top = components.pop(kind.__name__, schema)
    return json.dumps({**top, "$defs": components} if components else top).encode()
