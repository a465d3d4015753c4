"""Figures of the fault tests: one JSON for all, from which the table in docs/faults.md is made.

A test calls `record(number, test, **figures)`. `python -m tests.faults.figures` writes the table between the markers of
docs/faults.md; rows of faults without figures say so.
"""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[2]
ENVIRONMENT: Final = "COMPANION_FAULTS_JSON"
_DOCUMENT: Final = ROOT / "docs" / "faults.md"
_BEGIN, _END = "<!-- generated: faults -->", "<!-- end: faults -->"

Figures = dict[str, dict[str, dict[str, Any]]]
"""By number of the fault, then by name of the test."""


def figures_path() -> Path:
    """Where the figures are kept: as the environment says, else in build/."""
    return Path(os.environ.get(ENVIRONMENT) or ROOT / "build" / "faults.json")


def record(number: int, test: Any = None, **figures: Any) -> None:
    """Adds the figures of one test, the running one if none is named, in place of those of an earlier run; several
    processes may do so at once."""
    test = test or os.environ["PYTEST_CURRENT_TEST"].split("::")[-1].split(" ")[0]
    path = figures_path()
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        content: Figures = json.loads(file.read() or "{}")
        content.setdefault(f"{number:02d}", {})[test] = figures
        file.seek(0)
        file.truncate()
        json.dump(content, file, indent=2, sort_keys=True)
    print(f"fault {number}: {test}: {_listed(figures)}")


def table(content: Figures) -> str:
    """One row for each test, in the order of the faults."""
    rows = ["| # | test | figures |", "|---|---|---|"]
    rows += [
        f"| {int(number)} | `{test}` | {_listed(figures)} |"
        for number, tests in sorted(content.items())
        for test, figures in sorted(tests.items())
    ]
    return "\n".join(rows)


def write_document(content: Figures, document: Path = _DOCUMENT) -> None:
    """Puts the table between the markers. Raises ValueError for a document without them."""
    text = document.read_text(encoding="utf-8")
    before, begin, rest = text.partition(_BEGIN)
    _, end, after = rest.partition(_END)
    if not begin or not end:
        raise ValueError(f"{document}: expected the markers {_BEGIN} and {_END}")
    document.write_text(f"{before}{_BEGIN}\n\n{table(content)}\n\n{_END}{after}", encoding="utf-8")


def _listed(figures: dict[str, Any]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {_shown(value)}" for name, value in figures.items())


def _shown(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)


if __name__ == "__main__":
    write_document(json.loads(figures_path().read_text(encoding="utf-8")))
