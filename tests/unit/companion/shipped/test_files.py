"""What goes with the program goes with the wheel and the source archive too."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import companion
from companion.shipped.files import shipped_paths, shipped_text
from tests.paths import ROOT

_BUILT = ("companion", "wsr", "csi_bridge", "configs", "systemd")
_BUILD = "import sys; from setuptools import build_meta as b; _, out = sys.argv; b.build_wheel(out); b.build_sdist(out)"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Wheel and source archive of a copy of the tree: a build leaves folders behind."""
    tree, out = tmp_path_factory.mktemp("tree"), tmp_path_factory.mktemp("built")
    for name in _BUILT:
        shutil.copytree(ROOT / name, tree / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE", "requirements.txt"):
        shutil.copy(ROOT / name, tree)
    subprocess.run([sys.executable, "-c", _BUILD, str(out)], cwd=tree, check=True, capture_output=True, timeout=120)
    return out


def test_the_wheel_and_the_archive_hold_every_file_of_configs_and_systemd(built: Path) -> None:
    wanted = {
        str(path.relative_to(ROOT))
        for name in ("configs", "systemd")
        for path in (ROOT / name).rglob("*")
        if path.is_file()
    }
    wanted.add("requirements.txt")
    assert set(shipped_paths()) == wanted
    (wheel,) = built.glob("*.whl")
    inside = {name.removeprefix("companion/shipped/") for name in zipfile.ZipFile(wheel).namelist()}
    assert wanted <= inside
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as opened:
        files = {member.name.partition("/")[2] for member in opened if member.isfile()}
    assert {f"companion/shipped/{path}" for path in wanted} <= files


def test_a_program_installed_elsewhere_prints_its_examples(built: Path, tmp_path: Path) -> None:
    (wheel,) = built.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(tmp_path)
    command = [sys.executable, "-c", "import companion.cli; companion.cli.main()", "config", "example", "uav"]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, timeout=60, env={"PYTHONPATH": str(tmp_path)}
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == shipped_text("configs/uav.yaml")


def test_the_version_stands_in_one_place(built: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert "version" not in project and project["dynamic"] == ["version"]
    (wheel,) = built.glob("*.whl")
    assert wheel.name.split("-")[1] == companion.__version__
    changes = (ROOT / "CHANGELOG.md").read_text()
    assert f"\n## {companion.__version__}\n" in changes
