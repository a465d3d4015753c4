"""Mutants that are the same program, found by where they stand: a session of cosmic-ray has them skipped."""

from __future__ import annotations

import ast
import sqlite3
from collections.abc import Iterator
from pathlib import Path

Place = tuple[int, int]
"""Row from 1, column from 0."""


def skip_annotations(session: Path, source: Path) -> int:
    """Annotations are never evaluated (`from __future__ import annotations`); how many mutants stand in one."""
    spans = list(annotations(source.read_text()))
    with sqlite3.connect(session) as database:
        rows = database.execute(
            "SELECT job_id, start_pos_row, start_pos_col, end_pos_row, end_pos_col FROM mutation_specs"
        ).fetchall()
        inside = [
            job for job, *place in rows
            if any(begin <= (place[0], place[1]) and (place[2], place[3]) <= end for begin, end in spans)
        ]  # fmt: skip
        database.executemany(
            "INSERT OR REPLACE INTO work_results (worker_outcome, job_id) VALUES ('SKIPPED', ?)",
            [(job,) for job in inside],
        )
    database.close()
    return len(inside)


def annotations(source: str) -> Iterator[tuple[Place, Place]]:
    """Where each begins and ends, in a module that does not evaluate them."""
    tree = ast.parse(source)
    lazy = any(
        isinstance(node, ast.ImportFrom) and node.module == "__future__" and node.names[0].name == "annotations"
        for node in tree.body
    )
    for node in ast.walk(tree) if lazy else ():
        for name in ("annotation", "returns"):
            found = getattr(node, name, None)
            if isinstance(found, ast.expr):
                yield (found.lineno, found.col_offset), (found.end_lineno or 0, found.end_col_offset or 0)
