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


_PROGRAM = """
import sys
from numba.core.registry import CPUDispatcher
import numpy as np
from tests.unit.wsr.scene import WAVELENGTH_M, circle, exchange, weave
from wsr.aperture import make_aperture
from wsr.estimators import ESTIMATORS, warm_up

def compiled():
    found = {}
    for name, module in list(sys.modules.items()):
        if name.startswith("wsr"):
            for value in vars(module).values():
                if isinstance(value, CPUDispatcher):
                    found[value.py_func.__module__, value.__name__] = len(value.signatures)
    return found

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
    ended = subprocess.run(
        [sys.executable, "-c", _PROGRAM, name], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
