"""Figures of the fault tests: one JSON for all, from which the table in docs/results/faults.md is made.

A test calls `record(number, test, **figures)`. `python -m tests.faults.figures` puts what the JSON holds into the table
between the markers of docs/results/faults.md. A row is one test; those of which the JSON holds nothing stay, so that a
campaign may be run in pieces. Figures of a short run never take the place of a full one's.
"""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from tests.faults.campaigns import FULL

ROOT: Final = Path(__file__).resolve().parents[2]
ENVIRONMENT: Final = "COMPANION_FAULTS_JSON"
_DOCUMENT: Final = ROOT / "docs" / "results" / "faults.md"
_BEGIN, _END = "<!-- generated: faults -->", "<!-- end: faults -->"
_RUN: Final = "full" if FULL else "short"

Figures = dict[str, dict[str, dict[str, Any]]]
"""By number of the fault, then by name of the test: `run` (full or short) and `figures`."""
Rows = dict[tuple[int, str], tuple[str, str]]
"""Run and figures as text by number and name."""


def figures_path() -> Path:
    """Where the figures are kept: as the environment says, else in build/."""
    return Path(os.environ.get(ENVIRONMENT) or ROOT / "build" / "faults.json")


def record(number: int, test: Any = None, **figures: Any) -> None:
    """Adds the figures of one test, the running one if none is named, in place of those of an earlier run; several
    processes may do so at once."""
    test = test or os.environ["PYTEST_CURRENT_TEST"].split("::")[-1].rpartition(" (")[0]
    path = figures_path()
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+", encoding="utf-8") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        content: Figures = json.loads(file.read() or "{}")
        tests = content.setdefault(f"{number:02d}", {})
        if _may_replace(tests.get(test, {}).get("run", ""), _RUN):
            tests[test] = {"run": _RUN, "figures": figures}
        file.seek(0)
        file.truncate()
        json.dump(content, file, indent=2, sort_keys=True)
    print(f"fault {number}: {test}: {_listed(figures)}")


def table(rows: Rows) -> str:
    """One row for each test, in the order of the faults."""
    lines = ["| # | test | run | figures |", "|---|---|---|---|"]
    lines += [f"| {number} | `{test}` | {run} | {text} |" for (number, test), (run, text) in sorted(rows.items())]
    return "\n".join(lines)


def write_document(content: Figures, document: Path = _DOCUMENT) -> None:
    """Renews the table between the markers. Raises ValueError for a document without them."""
    text = document.read_text(encoding="utf-8")
    before, begin, rest = text.partition(_BEGIN)
    old, end, after = rest.partition(_END)
    if not begin or not end:
        raise ValueError(f"{document}: expected the markers {_BEGIN} and {_END}")
    rows: Rows = dict(_rows_of(old))
    for number, tests in content.items():
        for test, entry in tests.items():
            key = int(number), test
            if "run" in entry and _may_replace(rows.get(key, ("", ""))[0], entry["run"]):
                rows[key] = entry["run"], _listed(entry["figures"])
    document.write_text(f"{before}{_BEGIN}\n\n{table(rows)}\n\n{_END}{after}", encoding="utf-8")


def _may_replace(old_run: str, new_run: str) -> bool:
    return new_run == "full" or old_run != "full"


def _rows_of(table_text: str) -> Iterator[tuple[tuple[int, str], tuple[str, str]]]:
    for line in table_text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if len(cells) == 4 and cells[0].isdecimal():
            yield (int(cells[0]), cells[1].strip("`")), (cells[2], cells[3])


def _listed(figures: dict[str, Any]) -> str:
    return ", ".join(f"{name.replace('_', ' ')} {_shown(value)}" for name, value in figures.items())


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value + 0.0:.3g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)


if __name__ == "__main__":
    write_document(json.loads(figures_path().read_text(encoding="utf-8")))
