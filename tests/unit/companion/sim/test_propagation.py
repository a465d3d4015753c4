"""What reaches an antenna."""

from __future__ import annotations

import math

import numpy as np
import pytest

from companion.sim.propagation import propagate
from companion.sim.scenario import Reflector

LIGHT_M_S = 299_792_458.0
LAMBDA_M = LIGHT_M_S / 5.54e9


def test_a_reflector_adds_the_mirror_image() -> None:
    tx_m, rx_m = np.array([[0.0, 0.0, 1.5]]), np.array([[[7.0, 2.0, 0.5]]])
    ground = Reflector((0.0, 0.0, 1.0), 0.0, 0.3, 3.1)
    (found,) = propagate(tx_m, rx_m, 108, 0.5, [ground])[0, 14:15, 0]
    frequency_hz = 5.54e9 - 312_500.0
    expected = 0.0
    for gain, up_m in ((0.5, 1.5), (0.3 * np.exp(3.1j), -1.5)):
        d_m = math.dist((0.0, 0.0, up_m), (7.0, 2.0, 0.5))
        expected += gain * LAMBDA_M / (4 * math.pi * d_m) * np.exp(-2j * math.pi * frequency_hz * d_m / LIGHT_M_S)
    assert found == pytest.approx(expected, rel=1e-9)
