"""Poses played from a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from companion.core.clock import MonotonicClock
from companion.core.messages import Pose
from companion.errors import CompanionError
from companion.pose.recording import FilePoses

_CLOCK = MonotonicClock()


async def test_a_recording_of_places_alone_is_played_level(tmp_path: Path) -> None:
    """As the motion capture of the WSR data sets is; each row ends in a comma."""
    path, got = tmp_path / "rx_trajectory.csv", list[Pose]()
    path.write_text("".join(f"1000,{index * 10**7},{index / 10},2,0.2,\n" for index in range(3)))
    source = FilePoses(path, _CLOCK, got.append)
    await source.run()
    assert [pose.p_enu_m for pose in got] == [(0, 2, 0.2), (0.1, 2, 0.2), (0.2, 2, 0.2)]
    assert {pose.q_enu_from_body for pose in got} == {(1.0, 0.0, 0.0, 0.0)} and not source.has_attitudes


async def test_a_clock_that_stepped_back_for_a_moment_costs_those_poses(tmp_path: Path) -> None:
    path, got = tmp_path / "way.tum", list[Pose]()
    times = [1000 + 0.001 * index for index in range(40)]
    times[7] = 999.0
    path.write_text("".join(f"{t_s} {index / 100} 0 0 0 0 0 1\n" for index, t_s in enumerate(times)))
    await FilePoses(path, _CLOCK, got.append).run()
    assert [pose.p_enu_m[0] for pose in got] == [index / 100 for index in range(40) if index != 7]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("1 2 3\n", "line 1 has 3 columns"),
        ("# only\n", "empty file"),
        ("1 0 0 0 0 0 0 1\n2 nan 0 0 0 0 0 1\n", "no finite poses in 2 rows"),
        ("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 2 is stamped before"),
        ("1,2,3,4\n", "line 1 has 4 columns"),
        ("1,0,0,0,0\n2,0,0,0\n", "line 2 has 4 columns, expected 5"),
        ("1,0,0,0,0,0,0,0,1\n2,0,0,0,0\n", "line 2 has 5 columns, expected 9"),
    ],
)
def test_a_bad_recording_is_one_clear_error(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "bad.tum"
    path.write_text(text)
    with pytest.raises(CompanionError, match=named):
        FilePoses(path, _CLOCK, lambda _: None)
    with pytest.raises(CompanionError, match="No such file"):
        FilePoses(tmp_path / "missing", _CLOCK, lambda _: None)
