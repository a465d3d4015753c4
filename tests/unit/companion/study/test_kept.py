"""Finished trials on disk: found again, whole, and never those of other code."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from companion.errors import CompanionError
from companion.study import kept
from companion.study.kept import KeptRows


@dataclass(frozen=True, slots=True)
class Case:
    number: int


@dataclass(frozen=True, slots=True)
class Row:
    value: float
    parts: list[tuple[int, float | None]]


ROW = Row(0.1, [(1, None), (2, 0.25)])


def _kept(folder: Path, seed: int = 1) -> KeptRows[Case, Row]:
    return KeptRows(folder, "study", seed, Row)


def test_rows_are_found_again_by_their_specification_and_seed(tmp_path: Path) -> None:
    with _kept(tmp_path / "new") as rows:
        rows.add([Case(3), Case(4)], [ROW, Row(2.0, [])])
        assert rows.row(Case(3)) == ROW
    with _kept(tmp_path / "new") as again:
        assert (again.row(Case(3)), again.row(Case(4)), again.row(Case(5))) == (ROW, Row(2.0, []), None)
    with _kept(tmp_path / "new", seed=2) as other:
        assert other.row(Case(3)) is None


def test_half_a_line_of_a_killed_process_is_cut_off(tmp_path: Path) -> None:
    with _kept(tmp_path) as rows:
        rows.add([Case(1)], [ROW])
    with rows.path.open("ab") as file:
        file.write(b'{"spec":{"number":2},"row":{"va')
    with _kept(tmp_path) as again:
        assert again.row(Case(2)) is None
        again.add([Case(2)], [ROW])
    with _kept(tmp_path) as whole:
        assert (whole.row(Case(1)), whole.row(Case(2))) == (ROW, ROW)


@pytest.mark.parametrize(
    "line", [b"nonsense\n", b'{"row":{}}\n', b'{"spec":1,"row":{"value":"x","parts":[]}}\n', b"[1]\n"]
)
def test_a_line_that_is_no_trial_is_named(tmp_path: Path, line: bytes) -> None:
    with _kept(tmp_path) as rows:
        rows.add([Case(1)], [ROW])
    with rows.path.open("ab") as file:
        file.write(line)
    with pytest.raises(CompanionError, match=r"study-1-\w{8}\.jsonl: line 2 is no finished trial"), _kept(tmp_path):
        pass


def test_rows_of_other_code_are_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with _kept(tmp_path) as rows:
        rows.add([Case(1)], [ROW])
    monkeypatch.setattr(kept, "code_digest", lambda: "00000000")
    with _kept(tmp_path) as other:
        assert other.row(Case(1)) is None
    assert rows.path.stat().st_size > 0


def test_the_digest_is_of_what_a_trial_runs_on() -> None:
    names = {path.name for path in kept._sources()}
    assert {"tracker.py", "propagation.py", "rendezvous.py", "parser.py"} <= names
    assert not names & {"rendezvous_figures.py", "demo_view.py"}


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CompanionError, match="cannot be written"), _kept(tmp_path / "file"):
        pass
