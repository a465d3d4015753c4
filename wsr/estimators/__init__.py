"""Estimators: a checked aperture in, a direction with what it is worth and a profile out; pure and deterministic.

`ESTIMATORS` makes one with its defaults by the name that config and command line give: `robust` (the default),
`bartlett` (the paper's), `music` (the subspace method). The other modules are steps of these: `preparation`,
`stretches` and `source_number` before the search, `arrivals`, `cone`, `description` and `trust` after it. `warm_up`
loads or compiles the machine code of one of them. An estimator is imported, and Numba with it, when one is made: who
reads names and options has no use for a compiler.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wsr.aoa import Estimator


def _bartlett() -> Estimator:
    from wsr.estimators.bartlett import Bartlett

    return Bartlett()


def _robust() -> Estimator:
    from wsr.estimators.robust import Robust

    return Robust()


def _music() -> Estimator:
    from wsr.estimators.music import Music

    return Music()


ESTIMATORS: dict[str, Callable[[], Estimator]] = {"bartlett": _bartlett, "robust": _robust, "music": _music}


def warm_up(name: str = "robust") -> None:
    """Load or compile all machine code that an estimator uses, so that the first real estimate is as fast as the rest.
    Nothing of the others: loading that of `robust` takes a second."""
    from wsr import kernel
    from wsr.aperture import Aperture

    kernel.warm_up()
    rng = np.random.default_rng(0)
    # So many that the search of the sphere takes its fast way.
    count = 240
    t = np.linspace(0.0, 1.0, count)
    wave = np.ones((count, 30), np.complex64) + 0.1 * rng.normal(size=(count, 30)).astype(np.complex64)
    for height in (0.0, 0.3):
        chi = 0.2 * np.stack([np.cos(5 * t), np.sin(5 * t), height * np.sin(9 * t)], axis=-1)
        nic_us = np.stack([1e6 * t, 1e6 * t + rng.integers(300, 310, count)], axis=-1)
        aperture = Aperture(
            t_s=t,
            chi_m=chi,
            channel=np.ones(count, np.complex128),
            wavelength_m=0.05,
            reference_p_m=(0.0, 0.0, 0.0),
            reference_t_s=0.5,
            forward=wave,
            reverse=wave,
            nic_us=nic_us,
        )
        ESTIMATORS[name]().estimate(aperture)
