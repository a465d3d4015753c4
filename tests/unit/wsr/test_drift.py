"""Which drift of the phase can be told from a direction."""

from __future__ import annotations

import numpy as np

from benchmarks.scenes import WAVELENGTH_M
from benchmarks.simulated import arbitrary_path
from wsr.drift import is_told_apart
from wsr.focus import Focus


def test_a_line_does_not_tell_a_linear_phase_from_a_direction() -> None:
    tau = np.linspace(-0.5, 0.5, 200)
    line = np.outer(tau, [0.8, 0.5, 0.1]) + 1e-3 * np.random.default_rng(1).normal(size=(200, 3))
    focus = Focus(0.4, 1.4, None, 0.5)
    assert not is_told_apart(line, tau, WAVELENGTH_M, focus)
    assert is_told_apart(arbitrary_path(np.random.default_rng(2), packets=200), tau, WAVELENGTH_M, focus)
