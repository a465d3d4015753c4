"""What comes next, in every state of the mission."""

from __future__ import annotations

import pytest

from companion.mission.table import State
from companion.page.next_step import next_step
from tests.page_messages import known

MISSION = known()["mission"]


@pytest.mark.parametrize("state", [state.value for state in State])
def test_every_state_says_what_comes_next(state: str) -> None:
    assert "No word" not in next_step(state, "fly", MISSION)


def test_at_rest_it_says_whether_a_person_may_engage() -> None:
    assert "Ready" in next_step("idle", "fly", MISSION)
    assert "2 things stand" in next_step("idle", "fly", MISSION, missing=2)
    assert "Only observes" in next_step("idle", "observe", MISSION)
    assert next_step("latched", "fly", MISSION).startswith("Hands off")
