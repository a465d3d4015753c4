"""What a log shows in Foxglove."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from companion.core.inputs import Tick
from companion.core.messages import FlightMode, VehicleState, pose_bytes
from companion.core.streams import APERTURE, LOG, POSE, POSE_IN, PROFILE, TARGET, TICK, VEHICLE, Stream
from companion.guidance.target import Target, TargetReport, WholeBelief
from companion.log.foxglove import power_of
from companion.log.lines import LogLine
from companion.log.reader import read_log
from companion.log.recorder import McapRecorder
from companion.sensing.records import ApertureRecord
from tests.unit.companion.log.recorded import CONFIG, POSE_AT, clock


def one_of_each(path: Path) -> None:
    recorder = McapRecorder(path, CONFIG, clock())
    chi = np.arange(6.0).reshape(2, 3)
    vehicle = VehicleState(t_mono_ns=7, mode=FlightMode.HOLD, p_local_enu_m=(1.0, 2.0, 3.0), yaw_enu_rad=1.0)
    aperture = ApertureRecord(
        number=3, peer=2, start_ns=10, end_ns=20, t_s=np.zeros(2).tobytes(), chi_m=chi.tobytes(),
        channel=np.ones(2, complex).tobytes(), wavelength_m=0.05, reference_p_m=(1.0, 0.0, 0.0),
    )  # fmt: skip
    power = np.linspace(0, 1, 180 * 360).astype(np.float16).tobytes()
    certain = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))
    target = Target(
        t_mono_ns=9,
        azimuth_rad=0.5,
        origin_local_enu_m=(1.0, 1.0, 1.0),
        covariance_m2=certain,
        boot=4,
        range_m=6.0,
        range_std_m=0.3,
        probability=0.9,
        whole=WholeBelief(
            origin_local_enu_m=(1.0, 1.0, 1.0), covariance_m2=certain, range_90_m=(5.5, 6.5), direction_90_rad=0.1
        ),
    )
    messages: tuple[tuple[Stream, object], ...] = (
        (POSE, POSE_AT),
        (POSE_IN, pose_bytes(POSE_AT)),
        (VEHICLE, vehicle),
        (APERTURE, aperture),
        (PROFILE, power),
        (TARGET, TargetReport(t_mono_ns=9, peer=2, iteration=3, target=target, p_local_enu_m=(2.0, 3.0, 4.0))),
        (TICK, Tick(4)),
        (LOG, LogLine(logging.WARNING, "companion.flight.loop", "something")),
    )
    for stream, message in messages:
        recorder.record(stream, 5, message)
    recorder.close()


def test_foxglove_messages_decode_with_the_schemas_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    one_of_each(path)
    decoded = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            if schema is not None and schema.encoding == "protobuf":
                (decoder,) = filter(None, [DecoderFactory().decoder_for(channel.message_encoding, schema)])
                decoded[channel.topic] = schema.name, decoder(message.data)
    assert {topic: name for topic, (name, _) in decoded.items()} == {
        "/pose": "foxglove.PoseInFrame",
        "/tf": "foxglove.FrameTransforms",
        "/aperture/path": "foxglove.PosesInFrame",
        "/aoa/profile": "foxglove.Grid",
        "/scene": "foxglove.SceneUpdate",
        "/log": "foxglove.Log",
    }
    assert decoded["/pose"][1].pose.position.y == -2.0
    turns = {turn.child_frame_id: turn.translation for turn in decoded["/tf"][1].transforms}
    assert turns["body"].z == 3.0
    # A viewer that shows `local` finds every other frame from it.
    shown = {decoded[topic][1].frame_id for topic in ("/pose", "/aperture/path", "/aoa/profile")}
    assert shown <= turns.keys()
    here = turns["tracker"]
    there = POSE_AT.p_enu_m
    assert (here.x + there[0], here.y + there[1], here.z + there[2]) == pytest.approx((1.0, 2.0, 3.0))
    assert [p.position.x for p in decoded["/aperture/path"][1].poses] == [1.0, 4.0]
    assert decoded["/log"][1].message == "something"
    profile = decoded["/aoa/profile"][1]
    assert (profile.column_count, len(profile.data)) == (360, 180 * 360)
    assert profile.data[-1] == 255
    (logged,) = read_log(path, {PROFILE.topic})
    np.testing.assert_allclose(power_of(logged.data).ravel(), np.linspace(0, 1, 180 * 360), atol=0.003)
