"""One way of a robot as other tools write it, and what of it is read back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from companion.pose.trajectory_file import TrajectoryFile

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


def same(found: TrajectoryFile, turned: bool, from_s: float = 0.0) -> None:
    expected = np.array(ROWS)
    np.testing.assert_allclose(found.t_s, expected[:, 0] - from_s, atol=1e-6)
    np.testing.assert_allclose(found.p_m, expected[:, 1:4], atol=1e-5)
    assert (found.q_wxyz is not None) == turned
    if found.q_wxyz is not None:
        along = np.abs(np.sum(found.q_wxyz * expected[:, [7, 4, 5, 6]], axis=1))  # either sign is the same turn
        np.testing.assert_allclose(along, 1.0, atol=1e-6)


def changed(tmp_path: Path, line: int, old: str, new: str) -> Path:
    path = written(tmp_path, lambda row: numbers(row, "suxyzabcd"))
    lines = path.read_text().splitlines()
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    path.write_text("\n".join(lines) + "\n")
    return path
