"""A synthetic recorded run, and commands in this process."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from companion.cli import main
from tests.analyze_command import TX_PLACE, Cli, Ended
from tests.log_commands import Run
from tests.synthetic_run import RunFolder, write_run


@pytest.fixture
def cli(companion: Run) -> Cli:
    """`companion analyze ARGS` in this process, in an empty folder."""

    return lambda *arguments: Ended(*companion("analyze", *arguments))


@pytest.fixture
def companion(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """`companion ARGUMENTS` in this process, in an empty folder."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["companion", *map(str, arguments)])
        monkeypatch.chdir(tmp_path)
        code: Any = 0
        try:
            main()
        except SystemExit as exit_:
            code = exit_.code or 0
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture(scope="session")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_run(tmp_path_factory.mktemp("pristine"), TX_PLACE).folder


@pytest.fixture
def run(tmp_path: Path, pristine: Path) -> RunFolder:
    """A run of its own for each test, to be spoiled."""
    return RunFolder(Path(shutil.copytree(pristine, tmp_path / "set" / "position")))
