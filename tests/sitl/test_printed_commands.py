"""What the documents print is run as printed, in a fresh clone, in the order in which a reader would."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.paths import ROOT
from tests.printed_commands import RUN, Run

pytestmark = pytest.mark.long
_GOLDEN = ROOT / "tests" / "golden" / "approach.mcap"


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What git has of this tree, with a flight's log where the demo leaves its own."""
    folder = tmp_path_factory.mktemp("clone")
    done = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if done.returncode != 0:
        pytest.skip("no git, or no repository here")
    for name in done.stdout.decode().split("\0")[:-1]:
        if (ROOT / name).is_symlink() or (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)
    (folder / "demo-out").mkdir()
    shutil.copyfile(_GOLDEN, folder / "demo-out" / "log.mcap")
    return folder


@pytest.mark.parametrize("run", RUN, ids=lambda run: run.words)
def test_a_printed_command_does_what_it_says(clone: Path, run: Run) -> None:
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "PYTHONPATH": str(clone)}
    done = subprocess.run(
        f"companion {run.command}", shell=True, cwd=clone, env=environment, capture_output=True, text=True, check=False
    )
    said = done.stdout + done.stderr
    assert done.returncode == run.code, said
    assert run.says in said, said
    assert "Traceback" not in said
