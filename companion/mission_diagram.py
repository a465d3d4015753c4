"""The mission table as it stands in docs/safety.md; `python -m companion.mission_diagram docs/safety.md` renews it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from companion.errors import CompanionError
from companion.mission import TABLE, Event, State, step

BEGIN: Final = "<!-- generated: mission -->"
END: Final = "<!-- end of generated: mission -->"


def mermaid() -> str:
    """A state diagram: one arrow per pair of states, labelled with the events that take it."""
    arrows: dict[tuple[State, State], list[str]] = {}
    for (state, event), (target, _) in TABLE.items():
        if state is not target:
            arrows.setdefault((state, target), []).append(event.value)
    lines = [f"    {a} --> {b}: {', '.join(events)}" for (a, b), events in arrows.items()]
    return "\n".join(["stateDiagram-v2", f"    [*] --> {State.IDLE}", *lines])


def table_markdown() -> str:
    """One row per event in order of severity, one column per state: the next state and the actions."""
    states = list(State)
    rows = [["event", *states], ["---"] * (len(states) + 1)]
    rows += [[event.value, *_cells(event)] for event in Event]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def renewed(document: str) -> str:
    """The document with its generated part replaced. Raises CompanionError when the two markers are missing."""
    before, begin, rest = document.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise CompanionError(f"the document lacks the lines {BEGIN} and {END} around its generated part")
    return f"{before}{BEGIN}\n\n```mermaid\n{mermaid()}\n```\n\n{table_markdown()}\n\n{END}{after}"


def _cells(event: Event) -> Iterator[str]:
    for state in State:
        target, actions = step(state, event)
        words = [target.value] if target is not state else []
        yield ": ".join([*words, ", ".join(actions)] if actions else words) or "·"


if __name__ == "__main__":
    path = Path(sys.argv[1])
    path.write_text(renewed(path.read_text()))
