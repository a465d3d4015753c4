"""How much an aperture tells about a direction, fast enough to ask after every SAR iteration or before every leg.

Informativeness is 1 / (CRB_theta + sin^2 theta CRB_phi) [rad^-2], the inverse square of the great-circle bound with an
unknown phase: zero where the path determines nothing. Towards one source it presages the error there; the worst case
and the spread over directions say how much a path depends on where the source happens to be.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from wsr.aperture import Aperture
from wsr.crb.sphere import crb_over, great_circle_over, scatter_factor, tangents
from wsr.geometry import direction
from wsr.uncertainty import phase_variance

_STEP_RAD = math.radians(5.0)
_SHARE = 0.9
_EQUAL = 1e-9

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Directions (N,) with weights (N,) that sum to 1: where the source may be."""

    azimuth_rad: Array
    polar_rad: Array
    weight: Array


def sphere_prior(step_rad: float = _STEP_RAD) -> Prior:
    """Anywhere: a grid of `step_rad`, each point with its solid angle. Points lie half a step from the poles."""
    azimuth, polar = (a.ravel() for a in np.meshgrid(*_axes(step_rad)))
    weight = np.sin(polar)
    return Prior(azimuth, polar, weight / weight.sum())


@lru_cache(maxsize=1)
def _anywhere() -> Prior:
    return sphere_prior()


@lru_cache(maxsize=4)
def _tangents(prior: Prior) -> tuple[Array, Array]:
    """Of its directions, which most apertures share."""
    return tangents(prior.azimuth_rad, prior.polar_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """Great-circle bounds [rad^2] over a prior: the worst and where it is, and what `share` stay below."""

    worst_rad2: float
    worst_azimuth_rad: float
    worst_polar_rad: float
    percentile_rad2: float
    share: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Informativeness:
    """Of one aperture, in rad^-2: towards the source, and over all directions where it is least.

    `percentile_per_rad2` is reached or exceeded in 90 % of the directions. `phase_variance_rad2` is the noise it was
    computed for, per packet.
    """

    source_per_rad2: float
    worst_per_rad2: float
    worst_azimuth_rad: float
    worst_polar_rad: float
    percentile_per_rad2: float
    phase_variance_rad2: float


def spread(factor: Array, prior: Prior, share: float = _SHARE) -> Spread:
    """Worst and percentile over a prior, for a `wsr.crb.sphere.scatter_factor`."""
    bounds = great_circle_over(factor, *_tangents(prior))
    # Opposite directions have one bound: of such equals the first, whichever way the processor rounds.
    worst = int(np.argmax(bounds >= bounds.max() * (1.0 - _EQUAL)))
    order = np.argsort(bounds)
    reached = np.cumsum(prior.weight[order])
    at = min(int(np.searchsorted(reached, share * reached[-1])), bounds.size - 1)
    return Spread(
        worst_rad2=float(bounds[worst]),
        worst_azimuth_rad=float(prior.azimuth_rad[worst]),
        worst_polar_rad=float(prior.polar_rad[worst]),
        percentile_rad2=float(bounds[order[at]]),
        share=share,
    )


def informativeness(
    aperture: Aperture,
    azimuth_rad: float,
    polar_rad: float,
    phase_variance_rad2: float | None = None,
    prior: Prior | None = None,
) -> Informativeness:
    """Of an aperture whose source was found at (azimuth, polar angle).

    Without `phase_variance_rad2` the noise is that of the phases which this direction leaves unexplained in
    `aperture.channel`; turnaround jitter and second paths count into it. `prior` limits the directions over which the
    worst case and the percentile are taken; all of them, in steps of 5 degrees, if not given.
    """
    if phase_variance_rad2 is None:
        turns = 4 * np.pi / aperture.wavelength_m * (aperture.chi_m @ direction(azimuth_rad, polar_rad))
        turned = aperture.channel * np.exp(-1j * turns)
        phase_variance_rad2 = phase_variance(np.angle(turned * turned.sum().conj()))
    factor = scatter_factor(aperture.chi_m, aperture.wavelength_m, phase_variance_rad2)
    over = spread(factor, _anywhere() if prior is None else prior)
    return Informativeness(
        source_per_rad2=float(1.0 / crb_over(factor, azimuth_rad, polar_rad).great_circle_rad2[0]),
        worst_per_rad2=1.0 / over.worst_rad2,
        worst_azimuth_rad=over.worst_azimuth_rad,
        worst_polar_rad=over.worst_polar_rad,
        percentile_per_rad2=1.0 / over.percentile_rad2,
        phase_variance_rad2=phase_variance_rad2,
    )


def _axes(step_rad: float) -> tuple[Array, Array]:
    """Azimuths and polar angles of a grid of about `step_rad`."""
    rows = max(1, round(math.pi / step_rad))
    columns = max(1, round(2 * math.pi / step_rad))
    azimuth = np.linspace(-math.pi, math.pi, columns, endpoint=False)
    return azimuth, math.pi / rows * (np.arange(rows, dtype=np.float64) + 0.5)
