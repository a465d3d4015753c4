"""The first real aperture must not be the one that compiles: the worker would be taken for one that hangs."""

from __future__ import annotations

import subprocess
import sys

from tests.paths import ROOT

_PROGRAM = """
import sys
from numba.core.registry import CPUDispatcher
import numpy as np
from tests.unit.wsr.scene import WAVELENGTH_M, circle, exchange, weave
from wsr.aperture import make_aperture
from wsr.estimators import warm_up
from wsr.estimators.robust import Robust

def compiled():
    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("wsr"):
            for value in vars(module).values():
                if isinstance(value, CPUDispatcher):
                    found[value.py_func.__module__, value.__name__] = len(value.signatures)
    return found

warm_up()
before = compiled()
for path in (weave(60), weave(220), weave(900), circle(300)):
    t, p = path
    there, back = exchange(p, p.mean(axis=0) + np.array([[4.0, 3.0, -1.0]]))
    Robust().estimate(make_aperture(t, p, (there * back).mean(axis=1), WAVELENGTH_M, forward=there, reverse=back))
more = [name for name, count in compiled().items() if count != before.get(name)]
assert before["wsr.backprojection", "_back_project"] == 1, before
assert not more, more
"""


def test_nothing_is_compiled_after_the_warm_up() -> None:
    ended = subprocess.run([sys.executable, "-c", _PROGRAM], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
