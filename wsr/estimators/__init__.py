"""Estimators: a checked aperture in, a direction with what it is worth and a profile out; pure and deterministic.

`ESTIMATORS` makes one with its defaults by the name that config and command line give: `robust` (the default),
`bartlett` (the paper's), `music` (the subspace method). The other modules are steps of these: `preparation`,
`stretches` and `source_number` before the search, `arrivals`, `cone`, `description` and `trust` after it. `warm_up`
loads or compiles the machine code of one of them; `compile_search` and `compile_packets` share that out. An estimator
is imported, and Numba with it, when one is made: who reads names and options has no use for a compiler.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wsr.aoa import Estimator
from wsr.aperture import Aperture


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

    kernel.warm_up()
    for height in (0.0, 0.3):
        ESTIMATORS[name]().estimate(_any_aperture(height))


def compile_search() -> None:
    """Half of what `robust` compiles, by cost: what finds directions in bins. A process beside the one that calls
    `compile_packets` leaves it in the cache for both."""
    from wsr.subapertures import score, sub_apertures

    bins = 4
    channel, segment = np.ones((bins, 1), np.complex128), np.zeros(bins, np.int64)
    parts = sub_apertures(_any_aperture(0.3).chi_m[:bins], channel, segment, 0.05, scales=(1,)).condensed()
    score(parts, np.eye(3), [None], None)


def compile_packets() -> None:
    """The other half: what makes bins of packets, and profiles."""
    from wsr import kernel
    from wsr.estimators.options import RobustOptions
    from wsr.estimators.preparation import prepare

    kernel.warm_up()
    prepare(_any_aperture(0.3), RobustOptions())


def _any_aperture(height: float) -> Aperture:
    """A path that is level where `height` is 0, of so many packets that the search of the sphere takes its fast way."""
    rng = np.random.default_rng(0)
    count = 240
    t = np.linspace(0.0, 1.0, count)
    wave = np.ones((count, 30), np.complex64) + 0.1 * rng.normal(size=(count, 30)).astype(np.complex64)
    return Aperture(
        t_s=t,
        chi_m=0.2 * np.stack([np.cos(5 * t), np.sin(5 * t), height * np.sin(9 * t)], axis=-1),
        channel=np.ones(count, np.complex128),
        wavelength_m=0.05,
        reference_p_m=(0.0, 0.0, 0.0),
        reference_t_s=0.5,
        forward=wave,
        reverse=wave,
        nic_us=np.stack([1e6 * t, 1e6 * t + rng.integers(300, 310, count)], axis=-1),
    )
