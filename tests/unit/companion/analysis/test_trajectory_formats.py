"""`companion analyze` on the run of known truth, its trajectory written as other tools write theirs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

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


def rows(order: str, head: str = "", separator: str = ",", scale: float = 1.0) -> str:
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
        rows("tpq", f"Time,{NAMES}\n"),
        rows("tisupq", f"Time,header.seq,header.stamp.secs,header.stamp.nsecs,{NAMES}\n"),
        rows("tpw", "t,x,y,z,qw,qx,qy,qz\n"),
        rows("itpq", "seq,t,x,y,z,qx,qy,qz,qw\n"),
        rows("tpq", "# timestamp tx ty tz qx qy qz qw\n", " "),
        rows("tpq", "", "   "),
        rows("npw", "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"),
        rows("tp", "t,x [mm],y [mm],z [mm]\n", scale=1000),
        "\ufeff" + rows("tpq", "", "\t").replace("\n", "\r\n"),
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
        (rows("irqy", MOTIVE), "an OptiTrack Motive export.* expected on that host's clock, or --time-offset"),
        (rows("tpq"), "line 1 has 8 columns .* and no headings"),
        (rows("tpqi"), "nsec is"),
        (rows("itpq", "", " "), "9 columns separated by blanks .an index"),
        (rows("tp", "t,x,y,z\n", scale=1000), r"m/s after line .*expected below 30.*millimetres"),
        (rows("npq", "", " "), "line 1 is stamped 1.7e.18; expected seconds"),
    ],
)
def test_what_it_cannot_be_is_one_line(cli: Cli, run: RunFolder, text: str, named: str) -> None:
    run.trajectory.write_text(text)
    outcome = cli(run.folder, "--no-pictures")
    assert outcome.code == 1 and one_line(outcome), outcome
    assert re.search(named, outcome.err), outcome.err


def test_a_motive_export_with_its_offset(cli: Cli, run: RunFolder, tmp_path: Path) -> None:
    run.trajectory.write_text(rows("irqy", MOTIVE))
    assert cli(run.folder, "--no-pictures", "--json", "r.json", "--time-offset", str(START_S)).code == 0
    assert links(tmp_path / "r.json")["tx2"]["great_circle_error_deg"] < 1
