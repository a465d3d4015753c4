"""Messages as bytes of the log with their schemas, and the views that are drawn from them."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from companion.core.inputs import Tick
from companion.core.messages import Pose, Setpoint, VehicleState
from companion.core.streams import CSI, POSE, PROFILE, SETPOINT, TICK, TRANSFORMS, VEHICLE
from companion.log.encoding import encoded, schema_of, views
from companion.log.foxglove import power_of

_POSE = Pose(
    t_mono_ns=7, p_enu_m=(1.0, 2.0, 3.0), q_enu_from_body=(1.0, 0.0, 0.0, 0.0), v_enu_m_s=(0.0, 0.0, 0.0), confidence=3
)
_VEHICLE = VehicleState(t_mono_ns=7, p_local_enu_m=(1.0, 2.0, 1.5), yaw_enu_rad=0.3)


def test_bytes_stay_as_they_came_and_have_no_schema() -> None:
    assert encoded(CSI, 0, b"\xbb\x00") == (b"\xbb\x00", b"\xbb\x00")
    assert schema_of(b"\xbb\x00") == ("", "", b"")


@pytest.mark.parametrize("message", [Setpoint(7, None, (0.1, 0.0, 0.0), None), Tick(5, 0.25), _VEHICLE])
def test_a_dataclass_is_json_that_its_own_schema_describes(message: Any) -> None:
    data, source = encoded(TICK if isinstance(message, Tick) else SETPOINT, 0, message)
    name, kind, text = schema_of(source)
    schema = json.loads(text)
    assert (name, kind) == (type(message).__name__, "jsonschema")
    assert set(json.loads(data)) == set(schema["properties"])
    assert all(ref.split("/")[-1] in schema.get("$defs", {}) for ref in _references(schema))


def _references(value: Any) -> list[str]:
    if isinstance(value, dict):
        return [v for k, v in value.items() if k == "$ref"] + [r for v in value.values() for r in _references(v)]
    return [r for v in value for r in _references(v)] if isinstance(value, list) else []


def test_poses_and_profiles_are_foxgloves_and_say_the_same() -> None:
    data, source = encoded(POSE, 1_500_000_000, _POSE)
    name, kind, text = schema_of(source)
    assert (name, kind) == ("foxglove.PoseInFrame", "protobuf")
    assert any(file.name.startswith("foxglove/PoseInFrame") for file in FileDescriptorSet.FromString(text).file)
    assert type(source).FromString(data).pose.position.y == 2.0
    assert encoded(POSE, 1_500_000_000, _POSE)[0] == data, "the same bytes each time"
    power = np.random.default_rng(0).random((180, 360)).astype(np.float16)
    grid, _ = encoded(PROFILE, 0, power.tobytes())
    np.testing.assert_allclose(power_of(grid), power, atol=5e-3)


def test_a_vehicle_that_knows_where_it_is_is_drawn() -> None:
    ((stream, turns),) = views(VEHICLE, 5, _VEHICLE, _POSE)
    assert stream is TRANSFORMS
    assert turns.DESCRIPTOR.full_name == "foxglove.FrameTransforms"
    assert list(views(VEHICLE, 5, VehicleState(t_mono_ns=7))) == []
    assert list(views(SETPOINT, 5, Setpoint(7, None, (0.0, 0.0, 0.0), None))) == []
