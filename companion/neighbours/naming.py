"""Which robot a person means by a word. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from companion.errors import CompanionError
from companion.neighbours.neighbour import Neighbour


def named(word: str, robots: Sequence[Neighbour]) -> Neighbour:
    """The robot whose name or id `word` is.

    Raises CompanionError, with all there are, where it is neither, and where it is the name of one and the id of
    another: nobody may guess which of two a vehicle flies to.
    """
    found = {robot.id: robot for robot in robots if word in (robot.name, str(robot.id))}
    known = ", ".join(f"{robot.name} ({robot.id})" for robot in robots)
    if not found:
        raise CompanionError(f"no robot has the name or id {word!r}; expected one of {known}")
    if len(found) > 1:
        raise CompanionError(f"{word!r} is the name of one robot and the id of another; expected one of {known}")
    return next(iter(found.values()))
