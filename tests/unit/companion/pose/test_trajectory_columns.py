"""Which column holds what: by headings, else by a documented layout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.analysis.trajectories import PoseKind, read_trajectory
from companion.core.clock import MonotonicClock
from companion.errors import CompanionError
from companion.pose.recording import FilePoses
from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import read_trajectory_file
from tests.unit.companion.pose.written_way import ROWS, numbers, written

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
    ("txyzdabc", ",", "t,x,y,z,q[0],q[1],q[2],q[3]\n", r"q\[0\], q\[1\], q\[2\], q\[3\] may be an attitude in any"),
    ("txyzabcd", ",", "t,x,y,z,orientation[0],orientation[1],orientation[2],orientation[3]\n", "attitude in any order"),
    ("tyxz0000", ",", "timestamp [us],x,y,z,vx,vy,vz,heading\n", "x, y, z are PX4's vehicle_local_position, .* NED"),
    ("ttyxz", ",", "timestamp,timestamp_sample,x,y,z\n", "turn it to columns east, north, up"),
    ("t0yxz", ",", "timestamp,xy_valid,x,y,z\n", "which is NED: x North, y East, z down"),
    ("tyxz", ",", ",".join(["t", *(f"/fmu/out/vehicle_local_position/{a}" for a in "xyz")]) + "\n", "which is NED"),
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


def test_what_was_asked_for_is_no_place_beside_what_was_measured(tmp_path: Path) -> None:
    head = ",".join(["t", *(f"setpoint_position_{a}" for a in "xyz"), *(f"position_{a}" for a in "xyz")])
    path = written(tmp_path, lambda row: numbers(row, "t000xyz"), head + "\n")
    np.testing.assert_allclose(read_trajectory_file(path).p_m, [row[1:4] for row in ROWS], atol=1e-6)


@pytest.mark.parametrize("head", ["heading", "theta [rad]", "pitch", "rvec_x"])
def test_an_angle_that_is_not_read_is_said_unless_an_attitude_is(tmp_path: Path, head: str) -> None:
    path = written(tmp_path, lambda row: numbers(row, "txyzY"), f"t,x,y,z,{head}\n")
    found = read_trajectory_file(path)
    assert found.q_wxyz is None
    (note,) = found.notes
    assert note.startswith(f"{path}: {head} not used") and "yaw counter-clockwise from x" in note
    path = written(tmp_path, lambda row: numbers(row, "txyzabcdY"), f"t,x,y,z,qx,qy,qz,qw,{head}\n")
    assert read_trajectory_file(path).notes == ()


def test_what_was_turned_from_px4_is_taken_with_its_other_columns(tmp_path: Path) -> None:
    path = written(tmp_path, lambda row: numbers(row, "tyxz0000"), "timestamp,north,east,up,vx,vy,vz,heading\n")
    np.testing.assert_allclose(read_trajectory_file(path).p_m, [row[1:4] for row in ROWS], atol=1e-6)


def test_a_tab_keeps_a_heading_with_a_blank_together(tmp_path: Path) -> None:
    path = written(tmp_path, lambda row: numbers(row, "txyz0", "\t"), "time (s)\tx\ty\tz\tspeed\n")
    np.testing.assert_allclose(read_trajectory_file(path).p_m, [row[1:4] for row in ROWS], atol=1e-6)


def test_a_time_taken_for_seconds_and_nanoseconds_is_impossible(tmp_path: Path) -> None:
    """`time, x, y, z, qx, qy, qz, qw` with one more column has the width of the data sets' layout."""
    path = written(tmp_path, lambda row: numbers(row, "txyzabcd0"))
    with pytest.raises(TrajectoryError, match="nsec is"):
        read_trajectory_file(path)
