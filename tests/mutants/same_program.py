"""Mutants that are the same program, found by where they stand: a session of cosmic-ray has them skipped."""

from __future__ import annotations

import ast
import sqlite3
import types
from collections.abc import Iterator
from pathlib import Path

Place = tuple[int, int]
"""Row from 1, column from 0."""


def skip_same(session: Path, source: Path) -> None:
    """Those in annotations, which are never evaluated (`from __future__ import annotations`); of the options of a
    `@dataclass`, which only forbid; and of `zip(..., strict=)`, which only complains."""
    spans = list(idle(source.read_text()))
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


def skip_most(session: Path, every: int) -> None:
    """A sample: all but each `every`-th of those that are left, in the order of their places."""
    with sqlite3.connect(session) as database:
        jobs = database.execute(
            "SELECT job_id FROM mutation_specs WHERE job_id NOT IN (SELECT job_id FROM work_results) "
            "ORDER BY start_pos_row, start_pos_col, operator_name, occurrence"
        ).fetchall()
        database.executemany(
            "INSERT INTO work_results (worker_outcome, job_id) VALUES ('SKIPPED', ?)",
            [job for number, job in enumerate(jobs) if number % every],
        )
    database.close()


def idle(source: str) -> Iterator[tuple[Place, Place]]:
    """Where each of them begins and ends."""
    tree = ast.parse(source)
    lazy = any(
        isinstance(node, ast.ImportFrom) and node.module == "__future__" and node.names[0].name == "annotations"
        for node in tree.body
    )
    for node in ast.walk(tree):
        found = [getattr(node, "annotation", None), getattr(node, "returns", None)] if lazy else []
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("dataclass", "zip"):
            found += [keyword.value for keyword in node.keywords]
        for one in found:
            if isinstance(one, ast.expr):
                yield (one.lineno, one.col_offset), (one.end_lineno or 0, one.end_col_offset or 0)


def is_same(source: str, diff: str) -> bool:
    """Whether what a mutant's unified diff makes of the source compiles to the same: 1 | 2 and 1 + 2 are both 3."""
    return bool(_compiled(source) == _compiled(_changed(source, diff)))


def _compiled(source: str) -> tuple[object, ...]:
    def plain(code: types.CodeType) -> tuple[object, ...]:
        constants = [plain(one) if isinstance(one, types.CodeType) else (type(one), one) for one in code.co_consts]
        return code.co_code, code.co_names, code.co_varnames, constants

    return plain(compile(source, "", "exec", dont_inherit=True))


def _changed(source: str, diff: str) -> str:
    lines, made, at = source.splitlines(), list[str](), 0
    for line in diff.splitlines():
        if line.startswith("@@"):
            begin = int(line.split()[1].split(",")[0][1:]) - 1
            made += lines[at:begin]
            at = begin
        elif line.startswith(("---", "+++")) and not made and not at:
            continue
        elif line.startswith("+"):
            made.append(line[1:])
        else:
            at += 1
            if not line.startswith("-"):
                made.append(line[1:])
    return "\n".join(made + lines[at:]) + "\n"
