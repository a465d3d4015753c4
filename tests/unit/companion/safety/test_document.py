"""The parts of documents that are made from code say what the code does."""

from __future__ import annotations

import pytest

from companion.errors import CompanionError
from companion.mission.table import TABLE
from companion.safety import document
from tests.paths import DOCS


@pytest.mark.parametrize("name", document.PARTS)
def test_documents_are_current(name: str) -> None:
    text = (DOCS / name).read_text()
    assert document.renewed(name, text) == text, f"docs/{name} is old: run python -m companion.safety.document"


def test_diagram_names_every_state_and_transition() -> None:
    diagram = document.mermaid()
    for (state, event), (target, _) in TABLE.items():
        if state is not target:
            line = next(text for text in diagram.splitlines() if text.startswith(f"    {state} --> {target}: "))
            assert event.value in line.partition(": ")[2].split(", ")


def test_a_document_without_its_markers_is_refused() -> None:
    with pytest.raises(CompanionError, match=r"docs/vehicle\.md lacks the lines <!-- generated: axes -->"):
        document.renewed("vehicle.md", "no markers")
