"""OptiTrack Motive's export of one rigid body."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import read_trajectory_file
from tests.unit.companion.pose.written_way import ROWS, Row, same, written


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
