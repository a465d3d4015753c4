"""The house: no files stand on each other in a circle, the root stays small, the camera's reader needs nothing.

Which room may stand on which is a contract of import-linter in pyproject.toml.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import grimp
import pytest

import companion
from tests.paths import ROOT

_ROOT_MODULES = {"__init__", "__main__", "app", "cli", "errors"}


def test_no_circle_of_files() -> None:
    """Imports for type checking alone count too: a reader follows them just the same."""
    graph = grimp.build_graph("companion", "wsr", "csi_bridge", cache_dir=None)
    assert "wsr.estimators.robust" in graph.modules
    stands_on = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    TopologicalSorter(stands_on).prepare()  # raises CycleError, which names the circle


def test_the_root_holds_what_starts_the_program_and_nothing_else() -> None:
    modules = {path.stem for path in Path(companion.__path__[0]).glob("*.py")}
    assert modules <= _ROOT_MODULES, f"{', '.join(sorted(modules - _ROOT_MODULES))}: belongs in a room"


@pytest.mark.parametrize("package", ["companion", "companion/pose"])
def test_packages_on_the_way_to_the_camera_reader_import_nothing(package: str) -> None:
    (docstring,) = ast.parse((ROOT / package / "__init__.py").read_text()).body
    assert isinstance(docstring, ast.Expr)


def test_the_camera_reader_imports_where_nothing_is_installed() -> None:
    """-I and -S: neither this environment's packages nor its paths."""
    program = f"import sys; sys.path.insert(0, {str(ROOT)!r}); import companion.pose.t265_reader"
    done = subprocess.run([sys.executable, "-I", "-S", "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
