"""A log as a rosbag2: read back by the library that wrote it and by another one, message by message."""

from __future__ import annotations

import math
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

from companion.core.messages import VehicleState, pose_of
from companion.core.streams import BEARING, LOG, POSE_IN, SETPOINT, TARGET, TRANSFORMS, VEHICLE
from companion.log import foxglove
from companion.log.lines import LogLine
from companion.log.reader import LoggedMessage, open_session
from companion.log.ros2 import Ros2Exporter
from companion.log.ros2_messages import _times
from companion.log.writer import LogWriter
from companion.pose.trajectory_file import read_trajectory_file
from tests.log_commands import FLIGHT, Run, write_ulog


def exported(companion: Run, log: Path, out: Path) -> Path:
    code, text, err = companion("log", "export", log, "--ros2", "--out", out)
    assert code == 0 and str(out / "rosbag2") in text, err
    return out / "rosbag2"


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("flight") / "x"


@pytest.fixture
def flight_bag(companion: Run, kept: Path) -> Path:
    """Of the golden flight, written once, for tests that only read it."""
    return kept / "rosbag2" if kept.exists() else exported(companion, FLIGHT, kept)


def by_topic(bag: Path, *topics: str) -> dict[str, list[Any]]:
    """Those of `topics`, else all, as `mcap-ros2-support` decodes them."""
    found: dict[str, list[Any]] = {}
    with (bag / "rosbag2.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(topics or None):
            found.setdefault(channel.topic, []).append(message)
    return found


def test_two_readers_find_every_message_of_a_flight(flight_bag: Path) -> None:
    bag = flight_bag
    session = open_session(FLIGHT)
    logged = Counter(message.topic for message in session.messages())
    messages = by_topic(bag)
    assert len(messages["/pose"]) == len(messages["/pose/twist"]) == logged[POSE_IN.topic] > 3000
    assert len(messages["/setpoint"]) == logged[SETPOINT.topic] > 200
    # One of the twelve is none: its azimuth was not observable.
    assert logged[BEARING.topic] == 12 and len(messages["/bearing"]) == len(messages["/bearing/marker"]) == 11
    assert len(messages["/target"]) == logged[TARGET.topic]
    assert [one.data for one in messages["/mission"]][-1] == "approaching"
    with AnyReader([bag]) as reader:
        counts = {one.topic: one.msgcount for one in reader.connections}
        assert counts == {topic: len(found) for topic, found in messages.items()}
        types = {one.topic: one.msgtype for one in reader.connections}
        assert types["/bearing/marker"] == "visualization_msgs/msg/MarkerArray"
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)


def of_two_robots(folder: Path) -> Path:
    """A bag of one transform of each."""
    moved = foxglove.transforms(5, VehicleState(t_mono_ns=0, p_local_enu_m=(1.0, 2.0, 3.0), yaw_enu_rad=0.5))
    assert moved is not None
    exporter = Ros2Exporter(folder)
    for t_ns, robot in ((5, ""), (9, "rover/")):
        data = moved.SerializeToString()
        logged = LoggedMessage(topic=TRANSFORMS.topic, log_time_ns=t_ns, data=data, publish_time_ns=5)
        exporter.take(robot, TRANSFORMS.topic, logged)
    (bag,) = exporter.finish()
    return bag


def test_the_oldest_rosbag2_that_knows_mcap_can_open_it(tmp_path: Path) -> None:
    """Humble and Iron read the quality of service as one string, newer ones too where the version is below 9; an empty
    one not all of them."""
    bag = of_two_robots(tmp_path)
    told = YAML(typ="safe").load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (told["version"], told["storage_identifier"], told["compression_mode"]) == (8, "mcap", "")
    assert told["relative_file_paths"] == ["rosbag2.mcap"] == [file["path"] for file in told["files"]]
    (topic,) = told["topics_with_message_count"]
    assert told["message_count"] == topic["message_count"] == 2
    assert told["starting_time"]["nanoseconds_since_epoch"] == 5
    assert told["duration"]["nanoseconds"] in (4, 5)
    with (bag / "rosbag2.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    (channel,) = summary.channels.values()
    for text in (topic["topic_metadata"]["offered_qos_profiles"], channel.metadata["offered_qos_profiles"]):
        (profile,) = YAML(typ="safe").load(text)
        assert isinstance(text, str) and (profile["reliability"], profile["durability"]) == (1, 2)


def test_robots_of_a_merged_log_share_one_tree_of_frames(tmp_path: Path) -> None:
    turns = by_topic(of_two_robots(tmp_path))["/tf"]
    assert [one.transforms[0].child_frame_id for one in turns] == ["body", "rover/body"]


def test_poses_are_those_of_the_log(flight_bag: Path) -> None:
    poses = [(m, pose_of(m.data)) for m in open_session(FLIGHT).messages({POSE_IN.topic})]
    stamped = by_topic(flight_bag, "/pose")["/pose"]
    for (message, pose), found in zip(poses, stamped, strict=True):
        p, q, stamp = found.pose.position, found.pose.orientation, found.header.stamp
        assert (p.x, p.y, p.z) == pose.p_enu_m and (q.w, q.x, q.y, q.z) == pose.q_enu_from_body
        assert stamp.sec * 10**9 + stamp.nanosec == message.publish_time_ns
    assert stamped[0].header.frame_id == "tracker"
    again = read_trajectory_file(Path(f"{flight_bag}#/pose"))
    np.testing.assert_array_equal(again.p_m, [pose.p_enu_m for _, pose in poses])


def test_a_bearing_points_along_its_angles_and_a_target_has_its_covariance(flight_bag: Path) -> None:
    messages = by_topic(flight_bag, "/bearing", "/target", "/target/marker")
    logged = [msgspec.json.decode(m.data) for m in open_session(FLIGHT).messages({BEARING.topic})]
    logged = [record for record in logged if record["estimate"]["azimuth_observable"]]
    for record, found in zip(logged, messages["/bearing"], strict=True):
        q, estimate = found.pose.orientation, record["estimate"]
        turn = (q.w, q.x, q.y, q.z)
        _, x, y, z = _times(_times(turn, (0.0, 1.0, 0.0, 0.0)), (q.w, -q.x, -q.y, -q.z))
        assert math.atan2(y, x) == pytest.approx(estimate["azimuth_rad"], abs=1e-9)
        assert estimate["polar_observable"] is False or math.acos(z) == pytest.approx(estimate["polar_rad"], abs=1e-6)
        assert found.header.frame_id == "local"
    report = msgspec.json.decode(next(iter(open_session(FLIGHT).messages({TARGET.topic}))).data)
    covariance = np.array(messages["/target"][0].pose.covariance).reshape(6, 6)
    np.testing.assert_array_equal(covariance[:3, :3], report["target"]["covariance_m2"])
    (marker,) = messages["/target/marker"][0].markers
    assert (marker.type, marker.id) == (2, report["peer"])


def test_views_and_lines_of_a_merged_log_with_the_autopilots_inertial_data(companion: Run, tmp_path: Path) -> None:
    session, own = open_session(FLIGHT), tmp_path / "own.mcap"
    state = next(iter(session.messages({VEHICLE.topic})))
    vehicle = _Vehicle(msgspec.json.decode(state.data))
    turns = foxglove.transforms(5, vehicle)  # type: ignore[arg-type]
    assert turns is not None
    with own.open("wb") as file:
        writer = LogWriter(file, {"role": "uav", "name": "uav", "config": "{}"})
        writer.write(TRANSFORMS, 5, 5, 1, message=turns)
        writer.write(LOG, 7, 7, 2, message=LogLine(30, "companion.flight", "a warning"))
        writer.finish()
    messages = by_topic(exported(companion, own, tmp_path / "x"))
    assert [one.child_frame_id for one in messages["/tf"][0].transforms] == ["body"]
    (said,) = messages["/rosout"]
    assert (said.level, said.name, said.msg, said.stamp.nanosec) == (30, "companion.flight", "a warning", 7)
    write_ulog(tmp_path / "px4.ulg", session)
    assert companion("log", "merge", FLIGHT, "--ulg", tmp_path / "px4.ulg", "--out", tmp_path / "m.mcap")[0] == 0
    assert "/pose" in by_topic(exported(companion, tmp_path / "m.mcap", tmp_path / "y"))


class _Vehicle:
    def __init__(self, state: dict[str, Any]) -> None:
        self.p_local_enu_m, self.yaw_enu_rad = state["p_local_enu_m"], state["yaw_enu_rad"]


def test_a_bag_that_is_there_is_left_alone_and_nothing_is_left_of_a_log_without_one(
    companion: Run, tmp_path: Path
) -> None:
    bag = exported(companion, FLIGHT, tmp_path / "x")
    before = (bag / "rosbag2.mcap").read_bytes()
    code, _, err = companion("log", "export", FLIGHT, "--ros2", "--out", tmp_path / "x")
    assert code == 1 and "is there already" in err and (bag / "rosbag2.mcap").read_bytes() == before
    empty = tmp_path / "empty.mcap"
    with empty.open("wb") as file:
        LogWriter(file, {"role": "uav", "name": "uav", "config": "{}"}).finish()
    code, _, err = companion("log", "export", empty, "--ros2", "--out", tmp_path / "y")
    assert code == 1 and "holds nothing that ros2 could show" in err and not (tmp_path / "y").exists()


def test_without_the_library_its_extra_is_named(
    companion: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    code, _, err = companion("log", "export", FLIGHT, "--ros2", "--out", tmp_path / "x")
    assert code == 1 and "pip install 'wsr-companion[ros2]'" in err and not (tmp_path / "x").exists()
    assert companion("log", "export", FLIGHT, "--out", tmp_path / "x")[0] == 0, "the others need nothing of it"
