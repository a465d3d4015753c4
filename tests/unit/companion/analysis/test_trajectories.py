"""`companion analyze` on the run of known truth, its trajectory written as other tools write theirs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from companion.analysis.trajectories import PoseKind, read_trajectory
from companion.pose.trajectory_columns import TrajectoryError
from tests.analyze_command import Cli, links, one_line
from tests.synthetic_run import START_S, RunFolder, path_m

T_S = np.arange(0.0, 4.0, 0.01)
NAMES = "position.x,position.y,position.z,orientation.x,orientation.y,orientation.z,orientation.w"
MOTIVE = (
    "Format Version,1.23,Take Name,Take 001,Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global\n\n"
    f",,{'Rigid Body,' * 8}\n,,{'robot,' * 8}\n,,{'A,' * 8}\n"
    ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Mean Marker Error\n"
    "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,\n"
)


def told(order: str, head: str = "", separator: str = ",", scale: float = 1.0) -> str:
    lines = []
    for number, (t_s, p) in enumerate(zip(T_S, scale * path_m(T_S), strict=True)):
        ns = round((START_S + t_s) * 1e3) * 10**6
        parts = {
            "t": f"{START_S + t_s:.6f}",
            "n": str(ns),
            "s": str(ns // 10**9),
            "u": str(ns % 10**9),
            "r": f"{t_s:.6f}",
        }
        parts |= {"i": str(number), "q": separator.join("0001"), "w": separator.join("1000")}
        parts |= {"p": separator.join(f"{value:.6f}" for value in p), "y": f"{p[0]:.6f},{p[2]:.6f},{-p[1]:.6f}"}
        lines.append(separator.join(parts[letter] for letter in order) + "\n")
    return head + "".join(lines)


@pytest.mark.parametrize(
    "text",
    [
        told("tpq", f"Time,{NAMES}\n"),
        told("tisupq", f"Time,header.seq,header.stamp.secs,header.stamp.nsecs,{NAMES}\n"),
        told("tpw", "t,x,y,z,qw,qx,qy,qz\n"),
        told("itpq", "seq,t,x,y,z,qx,qy,qz,qw\n"),
        told("tpq", "# timestamp tx ty tz qx qy qz qw\n", " "),
        told("tpq", "", "   "),
        told("npw", "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"),
        told("tp", "t,x [mm],y [mm],z [mm]\n", scale=1000),
        "\ufeff" + told("tpq", "", "\t").replace("\n", "\r\n"),
    ],
)
def test_other_tools_trajectories_give_the_right_bearing(cli: Cli, run: RunFolder, tmp_path: Path, text: str) -> None:
    run.trajectory.write_bytes(text.encode())
    outcome = cli(run.folder, "--no-pictures", "--json", "r.json")
    assert outcome.code == 0, outcome.err
    assert links(tmp_path / "r.json")["tx2"]["great_circle_error_deg"] < 1


@pytest.mark.parametrize(
    ("text", "named"),
    [
        (told("irqy", MOTIVE), "an OptiTrack Motive export.* expected on that host's clock, or --time-offset"),
        (told("tpq"), "line 1 has 8 columns .* and no headings"),
        (told("tpqi"), "nsec is"),
        (told("itpq", "", " "), "9 columns separated by blanks .an index"),
        (told("tp", "t,x,y,z\n", scale=1000), r"m/s after line .*expected below 30.*millimetres"),
        (told("npq", "", " "), "line 1 is stamped 1.7e.18; expected seconds"),
    ],
)
def test_what_it_cannot_be_is_one_line(cli: Cli, run: RunFolder, text: str, named: str) -> None:
    run.trajectory.write_text(text)
    outcome = cli(run.folder, "--no-pictures")
    assert outcome.code == 1 and one_line(outcome), outcome
    assert re.search(named, outcome.err), outcome.err


def test_a_motive_export_with_its_offset(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    run.trajectory.write_text(told("irqy", MOTIVE))
    assert cli(run.folder, "--no-pictures", "--json", "r.json", "--time-offset", str(START_S)).code == 0
    assert links(tmp_path / "r.json")["tx2"]["great_circle_error_deg"] < 1


def rows(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("line", "t_s"),
    [
        ("1624840301.985819,0.000000,{},2,3,", 1624840301.985819),
        ("1624840302.0,21555063.0,{},2,3", 1624840302.021555063),
    ],
)
def test_both_ways_to_write_a_time(tmp_path: Path, line: str, t_s: float) -> None:
    path = rows(tmp_path / "t.csv", [line.format(1), line.format(1.5).replace("162484030", "162484040")])
    trajectory = read_trajectory(path, PoseKind.MOCAP)
    assert trajectory.t_s == pytest.approx([t_s, t_s + 100.0], abs=1e-6)
    assert trajectory.p_enu_m.tolist() == [[1, 2, 3], [1.5, 2, 3]]
    assert trajectory.q_wxyz is None


def test_odometry_is_turned_back_by_its_start_yaw_and_t265_is_not(tmp_path: Path) -> None:
    half = np.radians(40.0) / 2
    turned = f"{np.sin(half):.9f},{np.cos(half):.9f}"
    ahead = f"{np.cos(2 * half):.9f},{np.sin(2 * half):.9f}"
    path = rows(tmp_path / "o.csv", [f"1,0,5,6,0,0,0,{turned}", f"2,0,{ahead},0,0,0,{turned}"])
    odometry = read_trajectory(path, PoseKind.ODOM)
    assert odometry.q_wxyz == pytest.approx(np.tile([1.0, 0, 0, 0], (2, 1)), abs=1e-6)
    start = np.array([5, 6, 0])
    # Driving straight ahead of the start pose is driving along x.
    assert odometry.p_enu_m[1] == pytest.approx([1, 0, 0], abs=1e-6)
    assert np.linalg.norm(odometry.p_enu_m[0]) == pytest.approx(float(np.linalg.norm(start)))
    assert read_trajectory(path, PoseKind.T265).p_enu_m[0].tolist() == [5, 6, 0]


def test_jumps_are_counted_and_lost_poses_left_out(tmp_path: Path) -> None:
    lines = [f"{n / 100},0,{x},0,0" for n, x in enumerate([0, 0.01, "nan", 0.02, 1.02, 1.03])]
    trajectory = read_trajectory(rows(tmp_path / "t.csv", lines), PoseKind.MOCAP)
    assert len(trajectory.t_s) == 5
    assert [problem.split(": ")[1] for problem in trajectory.problems] == [
        "1 poses left out that are no numbers (nan or inf)",
        "1 jumps of more than 0.1 m; the tracker lost itself",
    ]


def test_odometry_without_attitude_is_refused(tmp_path: Path) -> None:
    path = rows(tmp_path / "odom.csv", ["1,0,0,0,0", "2,0,1,0,0"])
    with pytest.raises(TrajectoryError, match=r"odom\.csv: odometry without attitude"):
        read_trajectory(path, PoseKind.ODOM)


@pytest.mark.parametrize("value", ["1e155", "-100001", "1e308"])
def test_a_position_beyond_all_places_is_refused(tmp_path: Path, value: str) -> None:
    path = rows(tmp_path / "t.csv", ["1,0,99999,0,0", f"2,0,1,{value},0"])
    with pytest.raises(TrajectoryError, match=r"t\.csv: line 2 is .* m away"):
        read_trajectory(path, PoseKind.MOCAP)


def test_only_columns_at_the_end_may_be_empty(tmp_path: Path) -> None:
    path = rows(tmp_path / "t.csv", ["1,0,1,2,3, ,", "2,0,2,2,3,,"])
    assert read_trajectory(path, PoseKind.MOCAP).p_enu_m.tolist() == [[1, 2, 3], [2, 2, 3]]
    # Shifted, the quaternion's first number would be the height.
    rows(path, ["1,0,1,2,3,0,0,0,1", "2,0,1,,3,0,0,0,1"])
    with pytest.raises(TrajectoryError, match=r"t\.csv: line 2 has nothing in column 4"):
        read_trajectory(path, PoseKind.MOCAP)


def test_a_last_line_that_is_cut_off_is_left_out_and_reported(tmp_path: Path) -> None:
    whole = "".join(f"{n},0,{n / 100:.4f},0.1234,0.5678,\n" for n in range(4))
    for cut in (3, 12, 20):
        path = tmp_path / "t.csv"
        path.write_text(whole[:-cut])
        trajectory = read_trajectory(path, PoseKind.MOCAP)
        assert trajectory.p_enu_m[:, 2].tolist() == [0.5678] * 3
        assert len(trajectory.problems) == 1 and "last line, 4, is cut off" in trajectory.problems[0]
    path.write_text(whole + "  ")
    assert read_trajectory(path, PoseKind.MOCAP).problems == ()


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_headings_comments_and_a_byte_order_mark_are_passed_over(tmp_path: Path, ending: str) -> None:
    path = tmp_path / "t.csv"
    lines = ["# of run 1", "sec,nsec,x [m],y [m],z [m],", "1,0,1,2,3,", "", " # lost", "2,0,2,2,3,", ""]
    path.write_bytes(("\ufeff" + ending.join(lines)).encode())
    trajectory = read_trajectory(path, PoseKind.MOCAP)
    assert trajectory.p_enu_m.tolist() == [[1, 2, 3], [2, 2, 3]]
    assert trajectory.problems == ()
    rows(path, ["sec,nsec,x,y,z", "sec,nsec,x,y,z", "1,0,1,2,3"])
    with pytest.raises(TrajectoryError, match="line 2 is no row of numbers"):
        read_trajectory(path, PoseKind.MOCAP)
