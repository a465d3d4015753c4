"""Generated parts of the documents in docs/, between markers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

DOCS: Final = Path(__file__).resolve().parents[1] / "docs"
ABLATION: Final = DOCS / "results" / "ablation.md"
CROSS_VALIDATION: Final = DOCS / "results" / "crossvalidation.md"
SIMULATED: Final = DOCS / "results" / "simulated.md"


def replace_part(document: Path, name: str, lines: Iterable[str]) -> None:
    """Puts lines between `<!-- generated: NAME -->` and `<!-- end: NAME -->`. Raises ValueError without them."""
    begin, end = f"<!-- generated: {name} -->", f"<!-- end: {name} -->"
    text = document.read_text(encoding="utf-8")
    if text.count(begin) != 1 or text.count(end) != 1 or text.index(begin) > text.index(end):
        raise ValueError(f"{document}: expected one {begin} and below it one {end}")
    before, after = text[: text.index(begin) + len(begin)], text[text.index(end) :]
    document.write_text("\n".join([before, *lines, after]), encoding="utf-8")
