"""Units, stamps and quaternions that no robot has are told by line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from companion.pose.trajectory_columns import TrajectoryError
from companion.pose.trajectory_file import TrajectoryFile, read_trajectory_file
from tests.unit.companion.pose.written_way import changed

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
        (1 / 60, 0.1, "3000 poses a second"), (1000.0, 1.0, r"milliseconds\? A heading `time_ms` says so$"),
        (1e6, 1.0, "microseconds. A heading `time_us` says so. PX4, .* z down"), (1e9, 1.0, "nanoseconds.*`time_ns`"),
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


def test_microseconds_in_the_place_of_nanoseconds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "way.csv"
    path.write_text("".join(f"{n // 50},{n % 50 * 20000},{n / 500:.4f},0,0\n" for n in range(200)))
    with pytest.raises(TrajectoryError, match=r"within 0\.01 s of a whole second"):
        read_trajectory_file(path)


def test_stamps_that_step_back_are_left_out_if_few_and_refused_if_many(tmp_path: Path) -> None:
    found = read_trajectory_file(changed(tmp_path, 9, "80000000,", "10000000,"))
    assert len(found.t_s) == 29 and "1 poses left out from line 9 on" in found.notes[0]
    with pytest.raises(TrajectoryError, match="line 10 is stamped before one above, and so are 21 of 30"):
        read_trajectory_file(changed(tmp_path, 9, "1700000000,", "1700000001,"))
