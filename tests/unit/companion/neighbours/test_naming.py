"""Which robot a word means, and which it may not mean."""

from __future__ import annotations

import pytest

from companion.errors import CompanionError
from companion.neighbours.naming import named
from companion.neighbours.neighbour import Neighbour

_ROBOTS = (Neighbour(2, "alpha"), Neighbour(3, "beta"), Neighbour(7, "2"), Neighbour(9, "9"))


@pytest.mark.parametrize(("word", "robot"), [("alpha", 2), ("3", 3), ("7", 7), ("9", 9)])
def test_a_robot_goes_by_its_name_and_by_its_id(word: str, robot: int) -> None:
    assert named(word, _ROBOTS).id == robot


@pytest.mark.parametrize("word", ["", "Alpha", "alpha ", "03", "1"])
def test_a_word_that_is_neither_is_refused_with_all_there_are(word: str) -> None:
    with pytest.raises(CompanionError, match=r"no robot .* expected one of alpha \(2\), beta \(3\), 2 \(7\), 9 \(9\)"):
        named(word, _ROBOTS)


def test_a_name_that_is_another_ones_id_means_nobody() -> None:
    with pytest.raises(CompanionError, match="'2' is the name of one robot and the id of another"):
        named("2", _ROBOTS)
