"""What it costs to ask an aperture how much it tells: one direction, the whole sphere, and many directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.scenes import WAVELENGTH_M, helix
from benchmarks.timing import best_s
from wsr.crb import crb
from wsr.crb.informativeness import informativeness, sphere_prior, spread
from wsr.crb.sphere import crb_over, scatter_factor

PACKETS = 880


@dataclass(frozen=True, slots=True, kw_only=True)
class InformativenessTimes:
    """Seconds at 880 packets."""

    one_direction_s: float
    worst_case_s: float
    """Worst case and percentile over a grid of 5 degrees."""
    iteration_s: float
    """All that the worker adds to one SAR iteration: noise, one direction and the worst case."""
    sphere_s: float
    """Bounds of 64800 directions."""
    scalar_s: float
    """The same, one direction at a time: extrapolated from 100 of them."""


def informativeness_times() -> InformativenessTimes:
    aperture = helix(PACKETS)
    chi, prior = aperture.chi_m, sphere_prior()
    azimuth, polar = (np.radians(a.ravel()) for a in np.meshgrid(np.arange(1, 361), np.arange(1, 181)))

    def one_by_one() -> None:
        for p, t in zip(azimuth[:100].tolist(), polar[:100].tolist(), strict=True):
            crb(chi, WAVELENGTH_M, p, t)

    return InformativenessTimes(
        one_direction_s=best_s(lambda: crb_over(scatter_factor(chi, WAVELENGTH_M), 0.9, 1.8)),
        worst_case_s=best_s(lambda: spread(scatter_factor(chi, WAVELENGTH_M), prior)),
        iteration_s=best_s(lambda: informativeness(aperture, 0.9, 1.8)),
        sphere_s=best_s(lambda: crb_over(scatter_factor(chi, WAVELENGTH_M), azimuth, polar)),
        scalar_s=best_s(one_by_one, repeats=2) * azimuth.size / 100,
    )
