"""docs/safety.md says what the code does."""

from __future__ import annotations

import pytest

from companion.errors import CompanionError
from companion.mission.table import TABLE
from companion.safety import document
from tests.paths import DOCS

_SAFETY = DOCS / "safety.md"


def test_safety_document_is_current() -> None:
    text = _SAFETY.read_text()
    assert document.renewed(text) == text, (
        "docs/safety.md is old: run python -m companion.safety.document docs/safety.md"
    )


def test_diagram_names_every_state_and_transition() -> None:
    diagram = document.mermaid()
    for (state, event), (target, _) in TABLE.items():
        if state is not target:
            line = next(text for text in diagram.splitlines() if text.startswith(f"    {state} --> {target}: "))
            assert event.value in line.partition(": ")[2].split(", ")


def test_document_without_markers_is_refused() -> None:
    with pytest.raises(CompanionError, match="lacks the lines"):
        document.renewed("# Safety")
