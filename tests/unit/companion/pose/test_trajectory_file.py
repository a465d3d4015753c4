"""The one reader of trajectories: every documented format, and one clear line for what only looks like one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from companion.analysis.trajectories import PoseKind, read_trajectory
from companion.core.clock import MonotonicClock
from companion.errors import CompanionError
from companion.pose.recording import FilePoses
from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import TrajectoryFile, read_trajectory_file
from tests.paths import FIELD_CASES

Row = tuple[float, float, float, float, float, float, float, float]
ROWS: list[Row] = [
    (1_700_000_000 + n / 100, 1 + n / 200, -2 + n / 300, 0.3, 0.0, 0.0, np.sin(n / 50), np.cos(n / 50))
    for n in range(30)
]
"""t, x, y, z, qx, qy, qz, qw: the yaw is n / 25."""


def written(tmp_path: Path, line: Callable[[Row], str], head: str = "", name: str = "way.csv") -> Path:
    path = tmp_path / name
    path.write_bytes((head + "".join(f"{line(row)}\n" for row in ROWS)).encode())
    return path


def numbers(row: Row, order: str, separator: str = ",") -> str:
    """t in seconds, n in whole nanoseconds, s and u seconds and the nanoseconds beside, i an index, m millimetres."""
    t, x, y, z, qx, qy, qz, qw = row
    second, ns = int(t), round((t - int(t)) * 1e3) * 10**6
    parts = {
        "t": f"{t:.6f}", "n": f"{second}{ns:09d}", "s": f"{second}", "u": f"{ns}", "i": f"{ROWS.index(row)}",
        "x": f"{x:.6f}", "y": f"{y:.6f}", "z": f"{z:.6f}", "a": f"{qx:.9f}", "b": f"{qy:.9f}", "c": f"{qz:.9f}",
        "d": f"{qw:.9f}", "f": "map", "0": "0", "Y": f"{2 * np.arctan2(qz, qw):.9f}",
        "X": f"{1e3 * x:.3f}", "W": f"{1e3 * y:.3f}", "Z": f"{1e3 * z:.3f}", "M": f"{1e3 * (t - ROWS[0][0]):.3f}",
        "D": f"{np.degrees(2 * np.arctan2(qz, qw)):.9f}", "N": f"{-y:.6f}", "e": f"{-qz:.9f}",
    }  # fmt: skip
    return separator.join(parts[letter] for letter in order)


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


def same(found: TrajectoryFile, turned: bool, from_s: float = 0.0) -> None:
    expected = np.array(ROWS)
    np.testing.assert_allclose(found.t_s, expected[:, 0] - from_s, atol=1e-6)
    np.testing.assert_allclose(found.p_m, expected[:, 1:4], atol=1e-5)
    assert (found.q_wxyz is not None) == turned
    if found.q_wxyz is not None:
        along = np.abs(np.sum(found.q_wxyz * expected[:, [7, 4, 5, 6]], axis=1))  # either sign is the same turn
        np.testing.assert_allclose(along, 1.0, atol=1e-6)


@pytest.mark.parametrize(("unit", "scale"), [("Meters", 1), ("Millimeters", 1000)])
def test_a_motive_export_of_one_body(tmp_path: Path, unit: str, scale: int) -> None:
    head = (
        f"Format Version,1.23,Take Name,a,Rotation Type,Quaternion,Length Units,{unit},Coordinate Space,Global\n\n"
        f",,{'Rigid Body,' * 8}\n,,{'robot,' * 8}\n,,{'A,' * 8}\n"
        ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error\n"
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,\n"
    )

    def line(row: Row) -> str:
        t, x, y, z, qx, qy, qz, qw = row
        where = ",".join(f"{scale * value:.6f}" for value in (x, z, -y))
        return f"{ROWS.index(row)},{t - ROWS[0][0]:.6f},{qx},{qz},{-qy},{qw},{where},0.1"

    path = written(tmp_path, line, head)
    same(read_trajectory_file(path), True, ROWS[0][0])
    path.write_text(path.read_text().replace("30,0.29", "30,0.29") + "31,0.31,,,,,,,,\n")
    assert "1 frames without a pose" in read_trajectory_file(path).notes[0]
    for change, named in (
        (("Quaternion", "XYZ"), "Rotation Type xyz"),
        (("robot,robot", "robot,other"), "2 rigid bodies"),
        ((unit, "Inches"), "Length Units inches"),
        (("Space,Global", "Space,Local"), "Coordinate Space local"),
    ):
        bad = tmp_path / "bad.csv"
        bad.write_text(path.read_text().replace(*change, 1))
        with pytest.raises(TrajectoryError, match=f"OptiTrack Motive export: .*{named}"):
            read_trajectory_file(bad)


REFUSED = [
    ("txyzabcd", ",", "", "line 1 has 8 columns separated by ',' and no headings"),
    ("txyzabcdx", ",", "", "line 1: nsec is 1, not a whole|line 2: nsec is 1.005"),
    ("suxyz0abcd0", ",", "", "quaternion of norm"),
    ("itxyzabcd", " ", "", "9 columns separated by blanks .an index"),
    ("txyz", " ", "", "4 columns"),
    ("00xyzabcd000", " ", "", "KITTI"),
    ("nxyzabcd", " ", "", "line 1 is stamped 1.7e.18; expected seconds. If these are nanoseconds"),
    ("Mxyzabcd", " ", "", "line 2 is stamped 10 s after .* milliseconds"),
    ("tXWZ", ",", "t,x,y,z\n", "line .* m/s after line .*millimetres"),
    ("txyzabcd", ",", "sec,nsec,x,y,z,qx,qy,qz\n", "qw missing"),
    ("txyz", ",", "t,x,y,height\n", "z missing in its headings .t, x, y, height.; expected headings"),
    ("xyz", ",", "x,y,z\n", "a time missing"),
    ("txyzx", ",", "t,x,y,z,pose.position.x\n", "x and pose.position.x both say x"),
    ("ttxyz", ",", "t,sec,x,y,z\n", "t and sec are both a time"),
    ("txyz", ",", "t,x [furlong],y,z\n", "unit 'furlong' of x"),
    ("txyz", ",", "t,x_mm,y_m,z_m\n", "x_mm and y_m are not of one unit"),
    ("txyz", ",", "t,x,y,z [mm]\n", "x and z .mm. are not of one unit"),
    ("txyz00Y", ",", "t,x,y,z,roll_rad,pitch_rad,yaw_deg\n", "yaw_deg and pitch_rad are not of one unit"),
    ("txyzdabc", ",", "t,x,y,z,q0,q1,q2,q3\n", "q0, q1, q2, q3 may be an attitude in any order"),
    ("txyzdabc", ",", "t,x,y,z,qr,qi,qj,qk\n", "qr, qi, qj, qk may be an attitude in any order"),
    ("txyzabcd", ",", "t,tx,ty,tz,rx,ry,rz,rw\n", "rx, ry, rz, rw may be an attitude in any order"),
    ("txyzdabc", " ", "", "with w first it would stand"),
    ("txyz0", " ", "time [s] x y z speed\n", "line 2 has 5 columns, expected 6"),
    ("txyz", ",", "t,setpoint_position_x,setpoint_position_y,setpoint_position_z\n", "x, y, z missing in its headings"),
    ("txyz", ",", "t,target_position_x,target_position_y,target_position_z\n", "x, y, z missing in its headings"),
    ("tyxz", ",", "t,ned_pos_x,ned_pos_y,ned_pos_z\n", "ned_pos_x says ned; expected x, y, z turned to East"),
    ("sxyz", ",", "sec,x,y,z\n", "has the stamp of the one before"),
    ("txyz00D", ",", "t,x,y,z,roll,pitch,yaw\n", "expected radians"),
    ("txyz00", ",", "t,x,y,z\n", "line 2 has 6 columns, expected 4"),
]


@pytest.mark.parametrize(("order", "separator", "head", "named"), REFUSED)
def test_what_cannot_be_told_is_refused_by_name_and_by_flight_and_analysis_alike(
    tmp_path: Path, order: str, separator: str, head: str, named: str
) -> None:
    path = written(tmp_path, lambda row: numbers(row, order, separator), head)
    with pytest.raises(TrajectoryError, match=named) as told:
        read_trajectory_file(path)
    assert str(path) in str(told.value) and "\n" not in str(told.value)
    for reader in (lambda: read_trajectory(path, PoseKind.T265), lambda: FilePoses(path, MonotonicClock(), print)):
        with pytest.raises(CompanionError) as again:
            reader()
        assert str(told.value) in str(again.value)


def changed(tmp_path: Path, line: int, old: str, new: str) -> Path:
    path = written(tmp_path, lambda row: numbers(row, "suxyzabcd"))
    lines = path.read_text().splitlines()
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    path.write_text("\n".join(lines) + "\n")
    return path


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


STEADY = [f"{n / 50:.3f},{n / 500:.6f},0,0" for n in range(200)]
"""t, x, y, z of a robot at 0.1 m/s, for four seconds."""


def _of_steady(tmp_path: Path, scale_t: float, scale_m: float) -> TrajectoryFile:
    path = tmp_path / "steady.csv"
    values = [[float(one) for one in row.split(",")] for row in STEADY]
    path.write_text("t,x,y,z\n" + "".join(f"{t * scale_t:.7f},{x * scale_m:.6f},0,0\n" for t, x, *_ in values))
    return read_trajectory_file(path)


@pytest.mark.parametrize(
    ("scale_t", "scale_m", "named"),
    [
        (1.0, 110.0, "expected below 10, .*centimetres"), (1.0, 1000.0, "expected below 30, .*millimetres"),
        (1 / 60, 0.1, "3000 poses a second"), (1000.0, 1.0, "milliseconds"),
    ],
)  # fmt: skip
def test_other_units_without_a_heading_are_no_robots(
    tmp_path: Path, scale_t: float, scale_m: float, named: str
) -> None:
    assert len(_of_steady(tmp_path, 1.0, 1.0).t_s) == len(STEADY)
    with pytest.raises(TrajectoryError, match=named):
        _of_steady(tmp_path, scale_t, scale_m)


def test_what_goes_in_circles_in_minutes_is_too_fast_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "circle.csv"
    rows = [(n / 20 / 60, np.cos(n / 20), np.sin(n / 20)) for n in range(1200)]
    path.write_text("t,x,y,z\n" + "".join(f"{t:.7f},{x:.6f},{y:.6f},0\n" for t, x, y in rows))
    with pytest.raises(TrajectoryError, match=r"5\d(\.\d*)? m/s after line"):
        read_trajectory_file(path)


def test_noise_of_a_fast_camera_is_no_speed(tmp_path: Path) -> None:
    rng, path = np.random.default_rng(1), tmp_path / "noisy.csv"
    rows = [(n / 200, *rng.normal((0.4 * n / 200, 0.0, 0.0), 0.04)) for n in range(1000)]
    path.write_text("t,x,y,z\n" + "".join(f"{t:.4f},{x:.4f},{y:.4f},{z:.4f}\n" for t, x, y, z in rows))
    assert len(read_trajectory_file(path).t_s) == 1000


def test_zero_bytes_at_the_end_are_passed_over(tmp_path: Path) -> None:
    path = written(tmp_path, lambda row: numbers(row, "txyzabcd", " "))
    path.write_bytes(path.read_bytes() + bytes(4096))
    same(read_trajectory_file(path), True)


def test_microseconds_in_the_place_of_nanoseconds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_text("".join(f"{n // 50},{n % 50 * 20000},{n / 500:.4f},0,0\n" for n in range(200)))
    with pytest.raises(TrajectoryError, match=r"within 0\.01 s of a whole second"):
        read_trajectory_file(path)


def test_what_was_asked_for_is_no_place_beside_what_was_measured(tmp_path: Path) -> None:
    head = ",".join(["t", *(f"setpoint_position_{a}" for a in "xyz"), *(f"position_{a}" for a in "xyz")])
    path = written(tmp_path, lambda row: numbers(row, "t000xyz"), head + "\n")
    np.testing.assert_allclose(read_trajectory_file(path).p_m, [row[1:4] for row in ROWS], atol=1e-6)


def test_a_tab_keeps_a_heading_with_a_blank_together(tmp_path: Path) -> None:
    path = written(tmp_path, lambda row: numbers(row, "txyz0", "\t"), "time (s)\tx\ty\tz\tspeed\n")
    np.testing.assert_allclose(read_trajectory_file(path).p_m, [row[1:4] for row in ROWS], atol=1e-6)


def test_a_time_taken_for_seconds_and_nanoseconds_is_impossible(tmp_path: Path) -> None:
    """`time, x, y, z, qx, qy, qz, qw` with one more column has the width of the data sets' layout."""
    path = written(tmp_path, lambda row: numbers(row, "txyzabcd0"))
    with pytest.raises(TrajectoryError, match="nsec is"):
        read_trajectory_file(path)


def test_stamps_that_step_back_are_left_out_if_few_and_refused_if_many(tmp_path: Path) -> None:
    found = read_trajectory_file(changed(tmp_path, 9, "80000000,", "10000000,"))
    assert len(found.t_s) == 29 and "1 poses left out from line 9 on" in found.notes[0]
    with pytest.raises(TrajectoryError, match="line 10 is stamped before one above, and so are 21 of 30"):
        read_trajectory_file(changed(tmp_path, 9, "1700000000,", "1700000001,"))


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
