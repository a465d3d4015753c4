"""What docs/estimation.md and docs/results take from code: a row for every switch, parts to write them into, and the
cross-validation's arithmetic."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.document import ABLATION, CROSS_VALIDATION, SIMULATED, replace_part


def test_a_part_is_replaced_between_its_markers_and_nowhere_else(tmp_path: Path) -> None:
    document = tmp_path / "d.md"
    document.write_text("before\n<!-- generated: x -->\nold\n<!-- end: x -->\nafter\n")
    for _ in range(2):
        replace_part(document, "x", ["one", "two"])
        assert document.read_text() == "before\n<!-- generated: x -->\none\ntwo\n<!-- end: x -->\nafter\n"
    with pytest.raises(ValueError, match="generated: y"):
        replace_part(document, "y", ["one"])


@pytest.mark.parametrize(
    ("document", "name"), [(ABLATION, "ablation"), (SIMULATED, "simulated"), (CROSS_VALIDATION, "cross-validation")]
)
def test_the_document_has_the_part(document: Path, name: str, tmp_path: Path) -> None:
    copy = tmp_path / document.name
    copy.write_text(document.read_text())
    replace_part(copy, name, ["here"])
    assert f"<!-- generated: {name} -->\nhere\n" in copy.read_text()
