"""docs/safety.md numbers its promises: each has its rule or its test, and each rule its promise."""

from __future__ import annotations

import ast
import re

import pytest

from tests.faults.missions.promises import PROMISES
from tests.paths import DOCS, ROOT

_ROW = re.compile(r"^\| (\d+) \| (.+) \| `([\w/.:]+)` \|$", re.MULTILINE)


def _rows() -> list[tuple[int, str]]:
    """Number and what checks it, as the document lists them."""
    section = (DOCS / "safety.md").read_text().partition("## The promises")[2].partition("\n## ")[0]
    return [(int(number), check) for number, _, check in _ROW.findall(section)]


def test_the_promises_are_numbered_and_every_rule_is_one_of_them_in_order() -> None:
    rows = _rows()
    assert [number for number, _ in rows] == list(range(1, len(rows) + 1))
    assert [check for _, check in rows if "::" not in check] == [rule.__name__ for rule in PROMISES]


@pytest.mark.parametrize(("number", "rule"), list(enumerate(PROMISES, 1)))
def test_a_rule_says_which_promise_it_is(number: int, rule: object) -> None:
    assert (rule.__doc__ or "").startswith(f"{number}. ")
    assert dict(_rows())[number] == getattr(rule, "__name__", "")


@pytest.mark.parametrize("check", [check for _, check in _rows() if "::" in check])
def test_a_promise_without_a_rule_names_a_test_that_is_there(check: str) -> None:
    path, _, test = check.partition("::")
    module = ast.parse((ROOT / "tests" / path).read_text())
    functions = (node for node in module.body if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
    assert test in {function.name for function in functions}
