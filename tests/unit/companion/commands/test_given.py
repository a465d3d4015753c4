"""An option that a command would have to ignore is refused by its name."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.log_commands import FLIGHT, Run


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        *(
            (("demo", "--recording", "run"), words)
            for words in (("--json", "r.json"), ("--scene", "hall"), ("--gps",), ("--out", "o"), ("--max-time", "10"))
        ),
        (("report", FLIGHT), ("--poses", "t265")),
        (("replay", FLIGHT), ("--port", "0")),
        (("study", "crb", "--cluster", "local:1"), ("--jobs", "1")),
        (("analyze", "run", "--no-pictures"), ("--out", "o")),
        (("feed", "log.dat", "--unix", "s"), ("--connector-idx", "1")),
    ],
)
def test_what_would_be_ignored_is_refused(
    companion: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    mode: tuple[str | Path, ...],
    words: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, err = companion(*mode, *words)
    assert code == 2
    assert f"{words[0]} does not go together with" in err
    assert not any(tmp_path.iterdir())
