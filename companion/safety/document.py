"""The generated parts of docs/mission.md (states, faults) and docs/vehicle.md (hand moves, required parameters).

`python -m companion.safety.document` renews them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from companion.core.inputs import Event
from companion.errors import CompanionError
from companion.mission.table import TABLE, State, step
from companion.pose.hand_moves import MOVES, HandMove, expected_enu_m
from companion.safety.fault_table import FAULTS
from companion.safety.preflight import REQUIREMENTS

PARTS: Final = {"mission.md": ("mission", "faults"), "vehicle.md": ("axes", "parameters")}
"""The generated parts of each document."""
_DOCS: Final = Path(__file__).resolve().parents[2] / "docs"
_AXES: Final = ("East", "North", "Up")
_NOSES_RAD: Final = {"North": math.pi / 2, "East": 0.0}


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


def renewed(name: str, document: str) -> str:
    """The document of that name with its parts replaced. Raises CompanionError when the markers of one are missing."""
    texts = {
        "axes": axes_markdown(),
        "mission": f"```mermaid\n{mermaid()}\n```\n\n{table_markdown()}",
        "faults": faults_markdown(),
        "parameters": parameters_markdown(),
    }
    for part in PARTS[name]:
        begin, end = f"<!-- generated: {part} -->", f"<!-- end of generated: {part} -->"
        before, found, rest = document.partition(begin)
        _, closed, after = rest.partition(end)
        if not found or not closed:
            raise CompanionError(f"docs/{name} lacks the lines {begin} and {end} around its generated part")
        document = f"{before}{begin}\n\n{texts[part]}\n\n{end}{after}"
    return document


def faults_markdown() -> str:
    """One row per fault in order of severity: detection, what each state does about it, and what clears it."""
    rows = [["fault", "noticed within", "by", "action", "cleared by"], ["---"] * 5]
    for event in Event:
        if event in FAULTS:
            fault = FAULTS[event]
            rows.append([event.value, fault.within, fault.noticed_by, _actions(event), fault.cleared_by])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def axes_markdown() -> str:
    """One row per move of `companion check-axes`: what it must do, for two directions of the nose."""
    rows = [["move", *(f"nose to the {nose}" for nose in _NOSES_RAD)], ["---"] * (1 + len(_NOSES_RAD))]
    rows += [[move.instruction.format(d=1.0), *(_shown(move, yaw) for yaw in _NOSES_RAD.values())] for move in MOVES]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def parameters_markdown() -> str:
    """One row per required parameter of PX4."""
    rows = [["parameter", "needed", "wanted", "why"], ["---"] * 4]
    rows += [[r.name, r.needed.value, r.wanted, r.why] for r in REQUIREMENTS]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _shown(move: HandMove, yaw_rad: float) -> str:
    if move.turn_rad:
        east, north, _ = expected_enu_m(HandMove("", "", (1.0, 0.0, 0.0)), yaw_rad + move.turn_rad, 1.0)
        return "heading " + (("East" if east > 0 else "West") if abs(east) > 0.5 else "North" if north > 0 else "South")
    moved_m = expected_enu_m(move, yaw_rad, 1.0)
    return ", ".join(f"{axis} {m:+.0f} m" for axis, m in zip(_AXES, moved_m, strict=True) if abs(m) > 0.5)


def _actions(event: Event) -> str:
    """What happens, with the states in which it does; states that do the same stand together."""
    states: dict[str, list[str]] = {}
    for state in State:
        if (state, event) in TABLE:
            target, actions = step(state, event)
            what = ", ".join(actions) or "nothing is sent"
            states.setdefault(f"{what}; then {target}", []).append(state.value)
    return "; ".join(f"{what} (in {', '.join(names)})" for what, names in states.items())


def _cells(event: Event) -> Iterator[str]:
    for state in State:
        target, actions = step(state, event)
        words = [target.value] if target is not state else []
        yield ": ".join([*words, ", ".join(actions)] if actions else words) or "·"


if __name__ == "__main__":
    for name in PARTS:
        path = _DOCS / name
        path.write_text(renewed(name, path.read_text()))
