"""What counts as what of a mission."""

from __future__ import annotations

import pytest

from tests.unit.companion.study.mission_rows import mission


@pytest.mark.parametrize(
    ("reached_s", "arrived_m", "succeeded", "falsely", "silent"),
    [
        (35.0, 1.5, True, False, False),
        (35.0, None, False, False, True),
        (None, None, False, False, False),
        (None, 2.5, False, False, False),
        (None, 5.0, False, True, False),
        (35.0, 5.0, False, True, True),
    ],
)
def test_saying_so_and_being_there_are_told_apart(
    reached_s: float | None, arrived_m: float | None, succeeded: bool, falsely: bool, silent: bool
) -> None:
    row = mission(reached_s=reached_s, arrived_m=arrived_m)
    assert (row.succeeded, row.arrived_falsely, row.kept_silent) == (succeeded, falsely, silent)


def test_the_approach_ends_where_the_papers_mission_ended() -> None:
    assert [one.number for one in mission(reached_s=20.0).approach] == [0, 1, 2, 3, 4]
    assert len(mission(reached_s=None).approach) == 9
