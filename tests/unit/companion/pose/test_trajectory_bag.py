"""Trajectories out of bags: each message type, both storages, and a line for what is none."""

from __future__ import annotations

import json
import os
import random
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer as McapWriter

from companion.analysis.imported import analyze_session
from companion.log.reader import open_session
from companion.pose.trajectory_bag import read_bag
from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import read_trajectory_file
from tests.bags import STORE, Stamped, message, write_bag
from tests.faults.campaigns import FULL
from tests.log_commands import Run
from tests.synthetic_run import RunFolder

BEGIN_NS = 1_700_000_000_000_000_000
ROWS: list[Stamped] = [
    (BEGIN_NS + n * 10_000_000, (1 + n / 200, -2 + n / 300, 0.3, 0.0, 0.0, np.sin(n / 50), np.cos(n / 50)))
    for n in range(40)
]
MUTANTS = 2000 if FULL else 150


@pytest.mark.parametrize("is_mcap", [True, False])
@pytest.mark.parametrize("name", ["PoseStamped", "PoseWithCovarianceStamped", "Odometry"])
def test_each_type_in_each_storage(tmp_path: Path, name: str, is_mcap: bool) -> None:
    bag = write_bag(tmp_path / "bag", {"/way": (name, ROWS), "/talk": ("String", ROWS[:2])}, mcap=is_mcap)
    file = read_trajectory_file(bag)
    assert file.layout == f"rosbag2, /way ({name})" and file.notes == () and file.q_wxyz is not None
    np.testing.assert_array_equal(file.p_m, [row[:3] for _, row in ROWS])
    np.testing.assert_allclose(file.q_wxyz[:, [1, 2, 3, 0]], [row[3:] for _, row in ROWS], atol=1e-15)
    np.testing.assert_allclose(file.t_s - 1.7e9, [(t - ROWS[0][0]) / 1e9 for t, _ in ROWS], atol=3e-7)


def test_one_file_of_a_bag_and_one_topic_of_several(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", {"/a": ("PoseStamped", ROWS), "/b/odom": ("Odometry", ROWS[:20])})
    (file,) = bag.glob("*.mcap")
    assert len(read_trajectory_file(Path(f"{file}#/b/odom")).t_s) == 20
    assert len(read_trajectory_file(Path(f"{bag}#a")).t_s) == 40
    (stored,) = write_bag(tmp_path / "sql", {"/a": ("PoseStamped", ROWS)}, mcap=False).glob("*.db3")
    assert len(read_trajectory_file(stored).t_s) == 40
    with pytest.raises(TrajectoryError, match=r"2 topics .* choose one as .*#TOPIC: /a \(PoseStamped\), /b/odom"):
        read_trajectory_file(bag)
    with pytest.raises(TrajectoryError, match=r"no topic /c .* there are: /a"):
        read_trajectory_file(Path(f"{bag}#/c"))


def test_a_topic_whose_publisher_came_anew_is_read_whole(tmp_path: Path) -> None:
    kind = "geometry_msgs/msg/PoseStamped"
    with (tmp_path / "twice.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2", library="test")
        definition, _ = STORE.generate_msgdef(kind, ros_version=2)
        schema = writer.register_schema(kind, "ros2msg", definition.encode())
        channels = [writer.register_channel("/a", "cdr", schema, metadata={"publisher": name}) for name in "12"]
        for n, (t_ns, row) in enumerate(ROWS):
            data = bytes(STORE.serialize_cdr(message("PoseStamped", t_ns, row), kind))
            writer.add_message(channels[n // 20], t_ns, data, t_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    assert len(read_trajectory_file(tmp_path / "twice.mcap").t_s) == len(ROWS)


def test_what_a_killed_recorder_leaves_is_told_with_what_mends_it(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", {"/a": ("PoseStamped", ROWS)})
    (file,) = bag.glob("*.mcap")
    whole = file.read_bytes()
    file.write_bytes(whole[:-100])
    for path in (file, bag):
        with pytest.raises(TrajectoryError, match=r"bag\.mcap: its end is missing.* `mcap recover`"):
            read_trajectory_file(path)
    (bag / "metadata.yaml").unlink()
    with pytest.raises(TrajectoryError, match=r"no metadata\.yaml: `ros2 bag reindex .*or take one file.* bag\.mcap"):
        read_trajectory_file(bag)
    file.write_bytes(whole)
    assert len(read_trajectory_file(file).t_s) == len(ROWS)
    (tmp_path / "folder.mcap" / "inner.mcap").mkdir(parents=True)
    with pytest.raises(TrajectoryError, match=r"folder\.mcap: no metadata\.yaml"):
        read_trajectory_file(tmp_path / "folder.mcap")


def test_without_stamps_the_bags_own_times_count(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", {"/a": ("PoseStamped", ROWS)}, has_stamps=False)
    file = read_trajectory_file(bag)
    assert "the bag's own times are used" in file.notes[0]
    assert file.t_s[0] == pytest.approx(1.7e9)


def test_what_is_no_trajectory_says_what_would_be(tmp_path: Path) -> None:
    talk = write_bag(tmp_path / "talk", {"/talk": ("String", ROWS)})
    with pytest.raises(TrajectoryError, match=r"expected one of PoseStamped, .* it holds std_msgs/msg/String"):
        read_trajectory_file(talk)
    with pytest.raises(TrajectoryError, match="Is a directory"):
        read_trajectory_file(tmp_path)
    with pytest.raises(TrajectoryError, match="No such file"):
        read_trajectory_file(tmp_path / "missing.mcap")
    (tmp_path / "text.mcap").write_text("hello\n")
    with pytest.raises(TrajectoryError, match=r"text\.mcap: not a rosbag2 that can be read"):
        read_trajectory_file(tmp_path / "text.mcap")
    jump = write_bag(tmp_path / "jump", {"/a": ("PoseStamped", [(t, (1e9, *row[1:])) for t, row in ROWS])})
    with pytest.raises(TrajectoryError, match=r"1e\+09"):
        read_trajectory_file(jump)


@pytest.mark.long
def test_a_damaged_bag_ends_in_one_line(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", {"/a": ("PoseStamped", ROWS)})
    (file,) = bag.glob("*.mcap")
    whole, metadata = file.read_bytes(), (bag / "metadata.yaml").read_bytes()
    chance, refused = random.Random(4), 0
    for number in range(MUTANTS):
        target, content = [(file, whole), (bag / "metadata.yaml", metadata)][number % 3 == 0]
        mutant = bytearray(content)
        for _ in range(chance.choice((1, 1, 4))):
            mutant[chance.randrange(len(mutant))] = chance.randrange(256)
        if chance.random() < 0.2:
            del mutant[chance.randrange(len(mutant)) :]
        target.write_bytes(mutant)
        try:
            read_trajectory_file(bag)
        except TrajectoryError as error:
            refused += 1
            assert str(error).startswith(str(bag)) and "\n" not in str(error)
        file.write_bytes(whole)
        (bag / "metadata.yaml").write_bytes(metadata)
    assert refused > MUTANTS / 10


def test_without_the_library_its_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = write_bag(tmp_path / "bag", {"/a": ("PoseStamped", ROWS)})
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(TrajectoryError, match=r"pip install 'wsr-companion\[ros2\]'"):
        read_trajectory_file(bag)


def test_a_recorded_run_with_its_trajectory_in_a_bag_is_imported_and_analysed(
    run: RunFolder, companion: Run, tmp_path: Path
) -> None:
    file = read_trajectory_file(run.trajectory)
    turns = np.tile([1.0, 0, 0, 0], (len(file.t_s), 1)) if file.q_wxyz is None else file.q_wxyz
    poses = zip(file.t_s, file.p_m.tolist(), turns.tolist(), strict=True)
    rows = [(round(t * 1e9), (*p, q[1], q[2], q[3], q[0])) for t, p, q in poses]
    bag = write_bag(tmp_path / "bag", {"/drone/odom": ("Odometry", rows)})
    loose = ("--rx", run.rx, "--tx", run.tx, "--channel", "108", "--traj")
    code, _, err = companion("log", "import", *loose, bag, "--out", tmp_path / "logs")
    assert code == 0, err
    (log,) = (tmp_path / "logs").glob("*.mcap")
    target = tmp_path / "0.json"
    code, _, err = companion("analyze", *loose, run.trajectory, "--json", target, "--no-pictures")
    assert code == 0, err
    by_text = json.loads(target.read_text())["runs"][0]["links"][0]["azimuth_deg"]
    (link,) = analyze_session(open_session(log)).links
    assert link.estimate is not None
    assert np.degrees(link.estimate.azimuth_rad) == pytest.approx(by_text, abs=0.01)


@pytest.mark.parametrize("name", ["bag.mcap", "bag/bag_0.mcap", "bag/metadata.yaml"])
def test_a_named_pipe_in_the_place_of_a_file_is_not_waited_for(tmp_path: Path, name: str) -> None:
    pipe = tmp_path / name
    pipe.parent.mkdir(exist_ok=True)
    os.mkfifo(pipe)
    with pytest.raises(TrajectoryError, match=f"{name}: a named pipe, expected a file"):
        read_bag(pipe if name == "bag.mcap" else pipe.parent, [])
