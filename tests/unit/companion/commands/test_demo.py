"""What a demo that flies nothing has no use for is refused by its name."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.log_commands import Run


@pytest.mark.parametrize(
    "words", [("--json", "r.json"), ("--scene", "hall"), ("--gps",), ("--out", "o"), ("--max-time", "10")]
)
def test_what_would_be_ignored_is_refused(
    companion: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = companion("demo", "--recording", "run", *words)
    assert code == 2
    assert f"{words[0]} does not go together with" in err
    assert not any(tmp_path.iterdir())
