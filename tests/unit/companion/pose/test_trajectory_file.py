"""The one reader of trajectories: every documented format, and one clear line for what only looks like one."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import read_trajectory_file
from tests.paths import FIELD_CASES
from tests.unit.companion.pose.written_way import changed, numbers, same, written

EUROC = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], "
    "v_RS_R_x [m s^-1]\n"
)
EUROC_NS = EUROC.replace("#timestamp", "#timestamp [ns]").replace(", v_RS_R_x [m s^-1]", "").replace(", ", ",")
POSITION = "Time,position.x,position.y,position.z,orientation.x,orientation.y,orientation.z,orientation.w\n"
ECHO = (
    "%time,field.header.stamp,field.header.frame_id,field.pose.position.x,field.pose.position.y,field.pose.position.z,"
    "field.pose.orientation.x,field.pose.orientation.y,field.pose.orientation.z,field.pose.orientation.w\n"
)
BAGPY = (
    "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,pose.position.x,pose.position.y,"
    "pose.position.z,pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.orientation.w\n"
)


@pytest.mark.parametrize(
    ("order", "separator", "head", "turned"),
    [
        ("suxyz", ",", "", False),
        ("suxyzabcd", ",", "", True),
        ("suxyzabcd000000", ",", "", True),
        ("t0xyz", ",", "", False),
        ("txyzabcd", " ", "", True),
        ("txyzabcd", "   ", "# timestamp tx ty tz qx qy qz qw\n", True),
        ("txyzabcd", "\t", "# any comment\n\n", True),
        ("txyzdabc", " ", "# t x y z qw qx qy qz\n", True),
        ("nxyzdabc", ",", EUROC_NS, True),
        ("nxyzdabc0", ",", EUROC, True),
        ("txyzabcd", ",", POSITION, True),
        ("tisufxyzabcd", ",", BAGPY, True),
        ("nnfxyzabcd", ",", ECHO, True),
        ("ixyzt", ",", "seq,x,y,z,time\n", False),
        ("txyzabcd", ",", "time,x,y,z,qx,qy,qz,qw\n", True),
        ("txyzdabc", ",", '"t","x","y","z","qw","qx","qy","qz"\n', True),
        ("txyz00Y", ",", "stamp,x,y,z,roll,pitch,yaw\n", True),
        ("txyz00D", ";", "stamp;x;y;z;roll_deg;pitch_deg;yaw_deg\n", True),
        ("tXWZ", ",", "t,x [mm],y [mm],z [mm]\n", False),
        ("txyzdabc", " ", "% t x y z qw qx qy qz\n", True),
        ("txyzabcd", ",", "// recorded\nt,x,y,z,qx,qy,qz,qw\n", True),
        ("txyz", ";", "sep=;\nt;x;y;z\n", False),
        ("tfxyz", ",", "t,topic,x,y,z\n", False),
        ("ixyzt", ",", "id,x,y,z,time\n", False),
        ("suxyzdabc", ",", "stamp.sec,stamp.nanosec,x,y,z,qw,qx,qy,qz\n", True),
        ("itzyx", ",", ",t,up,north,east\n", False),
    ],
)  # fmt: skip
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_every_documented_format_gives_the_same_poses(
    tmp_path: Path, order: str, separator: str, head: str, turned: bool, ending: str
) -> None:
    path = written(tmp_path, lambda row: numbers(row, order, separator) + (" " if separator.isspace() else ""), head)
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", ending.encode()))
    same(read_trajectory_file(path), turned)


@pytest.mark.parametrize(
    ("line", "old", "new", "named"),
    [
        (4, "1700000000,", "1700000000.5,", "line 4: sec is 1700000000.5, not whole"),
        (4, "30000000,", "30000000.5,", "line 4: nsec is 3e.07, not a whole number"),
        (4, "30000000,", "1000000000,", "line 4: nsec is 1e.09"),
        (4, "30000000,", "-30000000,", "line 4: nsec is -3e.07"),
        (3, ",0.300000,", ",,", "line 3 has nothing in column 5"),
        (5, ",0.000000000,0.000000000", ",0.000000000,0.5", "line 5 has a quaternion of norm 1.12"),
        (6, ",0.300000", "", "line 6 has 8 columns, expected 9"),
        (7, "1.030000", "0x1", "line 7 is no row of numbers: x is '0x1'"),
        (7, "1.030000", "5300000.0", "line 7 is 5.3e.06 m away.*UTM"),
        (7, "1.030000", "9000.0", "line 7 is 8999 m from the first"),
        (
            9,
            "1700000000,",
            "1700000000000,",
            "line 9 is stamped 1.7e.12; expected seconds. If these are milliseconds|before",
        ),
    ],
)
def test_a_wrong_line_is_named(tmp_path: Path, line: int, old: str, new: str, named: str) -> None:
    with pytest.raises(TrajectoryError, match=named):
        read_trajectory_file(changed(tmp_path, line, old, new))


def test_zero_bytes_at_the_end_are_passed_over(tmp_path: Path) -> None:
    path = written(tmp_path, lambda row: numbers(row, "txyzabcd", " "))
    path.write_bytes(path.read_bytes() + bytes(4096))
    same(read_trajectory_file(path), True)


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (b"", "empty file"),
        (b"\n\n# nothing\n", "empty file"),
        (b"\x1f\x8b\x08\x00abc", "gzip: unpack it first"),
        (b"MATLAB 5.0 MAT-file" + bytes(200), "a MATLAB file"),
        (b"ULog\x01\x12\x35" + bytes(50), "a ULog of PX4"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:ab\n", "git lfs pull"),
        (b'{"fileType": "Plan"}\n', "a JSON file"),
        (b"t,x,y,z\n1,2,3,4\n" + bytes(9) + b"2,2,3,4\n", "line 3 holds zero bytes"),
        ("t,x,y,z\n1,2,3,4\n".encode("utf-16-le"), "line 1 holds zero bytes"),
        (b"t,x,y,z", "not one whole line"),
        (b't,x,y,z\n"' + b"a" * 140_000 + b'",1,2,3\n', "line 2 is no row of a table"),
        (b"t;x;y;z\n0,5;1;2;3\n", "t is '0,5'; expected a decimal point"),
        (b"0,5;1,0;2,0;3,0\n", "line 1 has decimal commas"),
        (b"\x28\xb5\x2f\xfd\x00abc", "zstd"),
        (b"PK\x03\x04abc", "zip archive"),
        ("t,x,y,z\n1,2,3,4\n".encode("utf-16"), "UTF-16 text; save it as UTF-8"),
        (b"t,x,y,z\n1,2,3,\xff\n", "not a text file"),
        (b"t,x,y,z\n", "no pose"),
        (b"t,x,y,z\n1,2,3,4\n", "only one pose"),
    ],
)
def test_what_is_no_trajectory_is_named(tmp_path: Path, content: bytes, named: str) -> None:
    path = tmp_path / "way.csv"
    path.write_bytes(content)
    with pytest.raises(TrajectoryError, match=named):
        read_trajectory_file(path)
    with pytest.raises(TrajectoryError, match="Is a directory"):
        read_trajectory_file(tmp_path)
    with pytest.raises(TrajectoryError, match="File name too long"):
        read_trajectory_file(tmp_path / ("n" * 300))


def test_the_messages_own_stamps_are_used_unless_they_are_all_zero(tmp_path: Path) -> None:
    path = written(tmp_path, lambda row: numbers(row, "tisufxyzabcd"), BAGPY)
    assert "stamps are those of header.stamp.secs, not Time" in read_trajectory_file(path).notes[0]
    path = written(tmp_path, lambda row: numbers(row, "ti00fxyzabcd"), BAGPY)
    found = read_trajectory_file(path)
    assert "stamps are those of Time" in found.notes[0]
    same(found, True)


@pytest.mark.skipif(not FIELD_CASES.is_dir(), reason="no field cases beside this clone")
def test_field_cases_of_recordings_are_named_or_cut_by_a_line() -> None:
    """Equivalents of each are among those above."""
    folder = FIELD_CASES / "recording-reader"
    for name in ("empty-cell.csv", "index-first.tum", "kitti.txt", "nanoseconds.tum"):
        with pytest.raises(TrajectoryError, match=f"{name}: line 1 "):
            read_trajectory_file(folder / name)
    cut = read_trajectory_file(folder / "cut-line.csv")
    assert len(cut.t_s) == 50 and "its last line, 51, is cut off" in cut.notes[0]
