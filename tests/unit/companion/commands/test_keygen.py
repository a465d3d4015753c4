"""`companion keygen`: one key a file, and no file that is there is replaced."""

from __future__ import annotations

import stat
from pathlib import Path

from companion.neighbours.keys import read_key
from tests.log_commands import Run


def test_each_file_gets_a_key_of_its_own_for_its_owner_alone(companion: Run, tmp_path: Path) -> None:
    first, second = tmp_path / "a.key", tmp_path / "b.key"
    code, out, _ = companion("keygen", first, second)
    assert (code, out) == (0, f"{first}: new key\n{second}: new key\n")
    assert read_key(first) != read_key(second)
    assert stat.S_IMODE(first.stat().st_mode) == 0o600


def test_a_key_that_is_there_stays(companion: Run, tmp_path: Path) -> None:
    assert companion("keygen", tmp_path / "a.key")[0] == 0
    before = (tmp_path / "a.key").read_bytes()
    code, out, err = companion("keygen", tmp_path / "a.key")
    assert (code, out) == (1, "")
    assert len(err.splitlines()) == 1
    assert (tmp_path / "a.key").read_bytes() == before
