"""A few trials of a study in this process, and what every study leaves behind."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from companion.study.report import draw, write_json, write_page
from companion.study.study import Outcome, Study
from companion.study.trials import Batch, run_batch

SEED = 1


def rows_of(one: Study[Any, Any], specs: Sequence[Any], first: int = 0) -> list[Any]:
    """In this process, as a worker would."""
    return run_batch(one.trial, Batch(first, tuple(specs), SEED))


def _outcome(one: Study[Any, Any], rows: list[Any]) -> Outcome:
    summary = one.summarise(rows)
    return Outcome(
        study=one.name,
        title=one.title,
        figures=one.figures,
        seed=SEED,
        trials=len(rows),
        elapsed_s=0.0,
        findings=summary.findings,
        notes=summary.notes,
        scenes=summary.scenes,
        rows=rows,
    )


def check_leftovers(one: Study[Any, Any], rows: list[Any], folder: Path) -> Outcome:
    """The picture can be drawn, and everything goes into JSON and the page."""
    outcome = _outcome(one, rows)
    picture = folder / f"{one.name}.png"
    draw(picture, one, outcome)
    assert picture.read_bytes().startswith(b"\x89PNG")
    write_json(folder / "result.json", outcome)
    assert json.loads((folder / "result.json").read_text())["study"] == one.name
    write_page(folder / "report.html", [outcome], {one.name: picture}, {})
    page = (folder / "report.html").read_text()
    assert "data:image/png;base64," in page
    assert all(finding.quantity.replace("<", "&lt;").replace("'", "&#x27;") in page for finding in outcome.findings)
    return outcome
