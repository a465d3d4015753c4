"""What all estimators share: their names, and a warm-up that leaves nothing to compile."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.paths import ROOT
from tests.unit.wsr.scene import aperture_towards, error_deg, weave
from wsr.estimators import ESTIMATORS
from wsr.geometry import direction


def test_estimators_by_name() -> None:
    t, p = weave(600)
    source = (p.mean(axis=0) + 40.0 * direction(2.1, 1.35))[None, :]
    for name in ("bartlett", "robust", "music"):
        estimate, _ = ESTIMATORS[name]().estimate(aperture_towards(t, p, source))
        assert error_deg(estimate, source) < 2.0, name


_COMPILED = """
import sys
from numba.core.registry import CPUDispatcher
import numpy as np
from tests.unit.wsr.scene import WAVELENGTH_M, circle, exchange, weave
from wsr.aperture import make_aperture
from wsr.estimators import ESTIMATORS, compile_packets, compile_search, warm_up

def compiled():
    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("wsr"):
            for value in vars(module).values():
                if isinstance(value, CPUDispatcher):
                    found[value.py_func.__module__, value.__name__] = len(value.signatures)
    return found
"""
_AFTER_THE_WARM_UP = """
warm_up(sys.argv[1])
before = compiled()
for path in (weave(60), weave(220), weave(900), circle(300)):
    t, p = path
    there, back = exchange(p, p.mean(axis=0) + np.array([[4.0, 3.0, -1.0]]))
    aperture = make_aperture(t, p, (there * back).mean(axis=1), WAVELENGTH_M, forward=there, reverse=back)
    ESTIMATORS[sys.argv[1]]().estimate(aperture)
more = [name for name, count in compiled().items() if count != before.get(name)]
assert not more, more
"""


@pytest.mark.parametrize(
    "name", ["robust", *(pytest.param(one, marks=pytest.mark.long) for one in ("bartlett", "music"))]
)
def test_nothing_is_compiled_after_the_warm_up(name: str) -> None:
    """The first real aperture must not be the one that compiles: the worker would be taken for one that hangs."""
    _run(_AFTER_THE_WARM_UP, name)


_IN_HALVES = """
compile_search()
searching = compiled()
assert searching["wsr.search", "search"] == searching["wsr.skeleton", "_condense"] == 1, searching
assert ("wsr.reciprocity", "_fold") not in searching, searching
compile_packets()
halves = compiled()
assert halves["wsr.search", "search"] == halves["wsr.reciprocity", "_fold"] == halves["wsr.kernel", "_sum_up"] == 1
warm_up("robust")
again = [name for name, count in compiled().items() if halves.get(name, count) not in (count, 0)]
assert not again, again
"""


def test_two_processes_share_out_what_the_worker_compiles() -> None:
    """Each half has what the other has not, in the form in which the estimator wants it."""
    _run(_IN_HALVES)


def _run(program: str, *arguments: str) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", _COMPILED + program, *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
