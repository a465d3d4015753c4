"""`wsr` is maths: no file, socket, clock, log, plot or event loop may come in, directly or by import."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import wsr

ALLOWED = {"__future__", "collections", "dataclasses", "functools", "math", "numba", "numpy", "typing", "wsr"}
FORBIDDEN_CALLS = {"open", "print", "input", "exec", "eval", "__import__"}
MODULES = sorted(Path(wsr.__path__[0]).rglob("*.py"))


def test_modules_are_found() -> None:
    assert {"aoa.py", "kernel.py"} <= {module.name for module in MODULES}


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.name)
def test_module_imports_and_calls_nothing_outside_maths(module: Path) -> None:
    for node in ast.walk(ast.parse(module.read_text())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module or ""]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in FORBIDDEN_CALLS, f"{module.name} calls {node.func.id}"
        for name in names:
            assert name.split(".")[0] in ALLOWED, f"{module.name} imports {name}"
