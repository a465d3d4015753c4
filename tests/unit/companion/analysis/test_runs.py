"""Which files belong to a run, and trajectories in the frame of the truth."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.analysis.runs import RecordingError, find_runs, loose_run, read_truth
from companion.analysis.trajectories import PoseKind
from tests.csi_records import needs_data
from tests.paths import DATA


def test_runs_of_several_folders_are_found_by_their_stamps(tmp_path: Path) -> None:
    for name in (
        "set/a/csi_rx_2021-06-27_203220.dat",
        "set/a/csi_tx2_2021-06-27_203220.dat",
        "set/a/csi_tx10_2021-06-27_203220.dat",
        "set/a/csi_tx3_2021-06-27_204108.dat",
        "set/a/rx_trajectory_2021-06-27_203220_.csv",
        "set/a/t265_rx_trajectory_2021-06-27_203220_.csv",
        "set/a/groundtruth_positions.json",
        "set/b_csi/csi_rx_2021-03-03_212019.dat",
        "set/b_traj/t265_rx_trajectory2021-03-03_212019.csv",
        "set/b_traj/rx_trajectory_2021-03-03_212019_.csv",
        "set/b_traj/rx_trajectory_2021-03-03_212146_.csv",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    first, second, third = find_runs(tmp_path)
    assert (first.stamp, first.title) == ("2021-06-27_203220", "set/a 2021-06-27_203220")
    assert sorted(first.tx) == ["tx10", "tx2"]
    assert sorted(first.trajectories) == [PoseKind.MOCAP, PoseKind.T265]
    assert first.truth == tmp_path / "set/a/groundtruth_positions.json"
    assert (second.rx, sorted(second.tx)) == (None, ["tx3"])
    assert {kind: path.name for kind, path in third.trajectories.items()} == {
        PoseKind.T265: "t265_rx_trajectory2021-03-03_212019.csv",
        PoseKind.MOCAP: "rx_trajectory_2021-03-03_212019_.csv",
    }
    assert third.truth is None


def _touch(*names: Path) -> None:
    for name in names:
        name.parent.mkdir(parents=True, exist_ok=True)
        name.touch()


def test_linked_folders_are_gone_into_and_each_real_one_counts_once(tmp_path: Path) -> None:
    disk, root = tmp_path / "disk", tmp_path / "sets"
    _touch(disk / "los/a/csi_rx_1.dat", disk / "los/b/csi_rx_2.dat", root / "z/c/csi_rx_3.dat")
    (root / "a-set").symlink_to(disk / "los")
    (root / "again").symlink_to(disk)
    (root / "b").symlink_to(disk / "los/b")
    (root / "to-c").symlink_to(root / "z/c")
    (root / "z/up").symlink_to(root)
    (disk / "los/around").symlink_to(disk)
    (root / "gone").symlink_to(tmp_path / "nowhere")
    found = [(run.folder.relative_to(root), run.title) for run in find_runs(root)]
    assert found == [(Path("a-set/a"), "los/a 1"), (Path("a-set/b"), "los/b 2"), (Path("z/c"), "z/c 3")]
    link = tmp_path / "link"
    link.symlink_to(root)
    assert [run.stamp for run in find_runs(link)] == ["1", "2", "3"]


def test_what_belongs_to_a_linked_run_is_found_beside_the_real_one(tmp_path: Path) -> None:
    disk, root = tmp_path / "disk/set", tmp_path / "mine"
    _touch(disk / "a_csi/csi_rx_1.dat", disk / "a_traj/rx_trajectory_1_.csv", disk / "groundtruth_positions.json")
    root.mkdir()
    (root / "a").symlink_to(disk / "a_csi")
    (run,) = find_runs(root)
    assert run.folder == root / "a"
    assert run.trajectories == {PoseKind.MOCAP: disk / "a_traj/rx_trajectory_1_.csv"}
    assert run.truth == disk / "groundtruth_positions.json"


def test_the_folder_one_stands_in_has_folders_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _touch(tmp_path / "csi/csi_rx_1.dat", tmp_path / "poses/rx_trajectory_1_.csv")
    monkeypatch.chdir(tmp_path / "csi")
    (run,) = find_runs(Path())
    assert run.trajectories == {PoseKind.MOCAP: tmp_path / "poses/rx_trajectory_1_.csv"}


@needs_data
def test_the_data_sets_are_complete_but_for_what_is_known() -> None:
    runs = find_runs(DATA)
    assert len(runs) == 33
    assert all(run.rx and run.truth and PoseKind.MOCAP in run.trajectories for run in runs)
    assert [run.stamp for run in runs if PoseKind.ODOM not in run.trajectories] == [
        "2021-03-03_212019",
        "2021-03-03_212146",
        "2021-03-03_212243",
        "2021-06-28_155827",
        "2021-06-28_160046",
    ]


@needs_data
def test_absent_transmitters_have_no_true_position() -> None:
    truth = read_truth(DATA / "wsr_3d/3D_1_RX_2_TX_formation_2/groundtruth_positions.json")
    assert truth.channel == 108
    assert sorted(truth.transmitters) == ["tx1", "tx3"]
    assert truth.transmitters["tx1"] == pytest.approx([0.0111, 2.5017, 0.3285], abs=1e-4)


def test_loose_files_are_named_by_their_file_names() -> None:
    run = loose_run(Path("a/csi_rx_x.dat"), (Path("csi_tx2_x.dat"), Path("other.dat")), Path("odom_x.csv"))
    assert sorted(run.tx) == ["other", "tx2"]
    assert list(run.trajectories) == [PoseKind.ODOM]
    with pytest.raises(RecordingError, match="two files of one transmitter"):
        loose_run(Path("r"), (Path("tx2_a.dat"), Path("tx2_b.dat")), Path("t.csv"))


@pytest.mark.parametrize(
    ("rx", "tx", "trajectory", "swapped"),
    [
        ("csi_tx2_1.dat", "csi_rx_1.dat", "rx_trajectory_1_.csv", True),
        ("tx2.dat", "rx.csi", "way.csv", True),
        ("csi_tx2_1.dat", "csi_rx_1.dat", "tx2_trajectory_1_.csv", False),
        ("csi_rx_1.dat", "csi_tx2_1.dat", "rx_trajectory_1_.csv", False),
        ("csi_tx2_1.dat", "csi_tx3_1.dat", "way.csv", False),
        ("heard_by_rx_of_tx2.dat", "heard_by_tx2_of_rx.dat", "way.csv", False),
        ("csi_tx2_1.dat", "csi_rx2_1.dat", "way.csv", False),
    ],
)
def test_names_that_say_the_other_end_are_refused_unless_the_trajectory_is_its_own(
    rx: str, tx: str, trajectory: str, swapped: bool
) -> None:
    if not swapped:
        assert loose_run(Path(rx), (Path(tx),), Path(trajectory)).rx == Path(rx)
        return
    with pytest.raises(RecordingError, match=f"the ends look swapped: --rx {rx} .* --tx {tx} "):
        loose_run(Path(rx), (Path(tx),), Path(trajectory))


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("Infinity", "channel.value is inf"),
        ("NaN", "channel.value is nan"),
        ("1e400", "channel.value is inf"),
        ("1" + "0" * 400, "too large"),
        ("108.5", "not a whole number"),
        ("[]", "channel.value"),
    ],
)
def test_a_channel_that_is_no_number_is_refused(tmp_path: Path, value: str, reason: str) -> None:
    path = tmp_path / "truth.json"
    path.write_text('{"channel": {"value": VALUE}, "true_tx_positions": {"value": {}}}'.replace("VALUE", value))
    with pytest.raises(RecordingError, match=rf"truth\.json: .*{reason}"):
        read_truth(path)


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-1e400", "1e155"])
def test_a_true_position_that_is_no_place_is_refused(tmp_path: Path, value: str) -> None:
    path = tmp_path / "truth.json"
    places = '{"tx3": {"position": {"x": 1, "y": VALUE, "z": 0}}}'.replace("VALUE", value)
    path.write_text('{"channel": {"value": 108}, "true_tx_positions": {"value": PLACES}}'.replace("PLACES", places))
    with pytest.raises(RecordingError, match=r"truth\.json: position of tx3 is \[1\.0, .*expected metres"):
        read_truth(path)


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ('"channel":', '"channel": {"value": 36}, "channel":', "channel is there twice"),
        ('"tx3":', '"tx3": {"position": {"x": 9, "y": 9, "z": 9}}, "tx3":', "tx3 is there twice"),
        ('"z": 2', '"z": true', r"tx3\.position\.z is true, no number"),
        ("108", "true", r"channel\.value is true, no number"),
        (', "z": 2', "", "key 'z' is missing"),
        ('{"x": 1, "y": 3, "z": 2}', "[1, 3, 2]", r"position holds \[1, 3, 2\], no keys; expected .*NAME\.position"),
        ("}}}}}", "}}}}},", "line 1: Extra data"),
        ('{"channel"', "\n\nchannel", "line 3: Expecting value"),
    ],
)
def test_what_is_wrong_in_a_truth_file_is_named(tmp_path: Path, old: str, new: str, named: str) -> None:
    path = tmp_path / "truth.json"
    place = '"tx3": {"position": {"x": 1, "y": 3, "z": 2}}'
    text = '{"channel": {"value": 108}, "true_tx_positions": {"value": {' + place + "}}}"
    path.write_text(text)
    assert read_truth(path).transmitters["tx3"].tolist() == [1.0, 3.0, 2.0]
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(RecordingError, match=rf"truth\.json: .*{named}") as told:
        read_truth(path)
    assert "\n" not in str(told.value)
    path.write_bytes(text.encode("utf-16"))
    with pytest.raises(RecordingError, match="not UTF-8"):
        read_truth(path)


def test_a_link_out_of_the_data_set_costs_no_hours(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("companion.analysis.runs._MOST_FOLDERS", 10)
    for name in range(20):
        (tmp_path / "far" / str(name)).mkdir(parents=True)
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "link").symlink_to(tmp_path / "far")
    with pytest.raises(RecordingError, match="set: more than 10 folders below; name that of the recordings"):
        find_runs(tmp_path / "set")


def test_two_logs_of_one_end_are_named(tmp_path: Path) -> None:
    for name in ("csi_rx_2026-01-02_030405.dat", "csi_rx_2026-01-02_030405.csi"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(
        RecordingError, match=r"csi_rx_.*\.csi and csi_rx_.*\.dat: which is the run's\?|\.dat and .*\.csi:"
    ):
        find_runs(tmp_path)
