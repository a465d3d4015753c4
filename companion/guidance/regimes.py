"""Kinds of rooms, as bearings know them: how far these are off, how often, and for how long in the same way.

Nobody says which room a vehicle is in. The belief keeps with each place of the target the probability of each kind, and
bearings decide: a bank of filters over the same places, whose shares are the models' posterior (Bar-Shalom, Li and
Kirubarajan, Estimation with Applications, 11.6). docs/guidance.md says where the numbers come from.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


class Regime(NamedTuple):
    """One kind of room. Deviations are beside a bearing's own, which knows noise alone, and what poses drift by."""

    prior: float
    across_std_rad: float
    down_std_rad: float
    elevation_std_rad: float
    """By how much floor and ceiling, which mirror a source below and above itself, pull all bearings of one place."""
    reported: tuple[float, float, float]
    """Probability that the reported path is the direct one: from near, from afar, and what reliability 1 adds. Images
    are as far as before when the target is near: then the direct path is the loudest."""
    others: float
    """That one of all other paths together is."""
    unseen: tuple[float, float]
    """How often no range shows: from near, and from afar."""
    trusted: float
    """Share of the ranges that are the source's. Echoes bend the wave front too."""
    reliability: float
    """Mean of the bearings' own."""
    counted: float
    """Of an aperture, for the place: less where errors last longer than one."""
    heard: float
    """The same of received power, which echoes fade."""


KIND: Final = Regime(
    prior=0.4,
    across_std_rad=math.radians(2.0),
    down_std_rad=math.radians(2.2),
    elevation_std_rad=math.radians(1.8),
    reported=(0.93, 0.9, 0.06),
    others=0.1,
    unseen=(0.12, 0.62),
    trusted=0.8,
    reliability=0.45,
    counted=1.0,
    heard=1.0,
)
"""Little but the direct path."""
ECHOING: Final = Regime(
    prior=0.3,
    across_std_rad=math.radians(5.0),
    down_std_rad=math.radians(8.0),
    elevation_std_rad=math.radians(8.0),
    reported=(0.85, 0.7, 0.2),
    others=0.2,
    unseen=(0.2, 0.7),
    trusted=0.5,
    reliability=0.25,
    counted=0.8,
    heard=0.8,
)
"""Strong walls, or poses that drift."""
HARD: Final = Regime(
    prior=0.3,
    across_std_rad=math.radians(5.5),
    down_std_rad=math.radians(9.0),
    elevation_std_rad=math.radians(12.0),
    reported=(0.8, 0.3, 0.4),
    others=0.3,
    unseen=(0.75, 0.95),
    trusted=0.5,
    reliability=0.07,
    counted=0.7,
    heard=0.4,
)
"""Images are louder than the direct path."""
REGIMES: Final = (KIND, ECHOING, HARD)

_CHANGES: Final = 0.02
"""How often an aperture is flown in another kind of room than the one before."""
_LEAST_LOG: Final = -100.0
_PRIOR: Final = np.array([regime.prior for regime in REGIMES])
_ELEVATION_RAD: Final = np.array([regime.elevation_std_rad for regime in REGIMES])
_COUNTED: Final = np.array([regime.counted for regime in REGIMES])[:, None]
_HEARD: Final = np.array([regime.heard for regime in REGIMES])[:, None]


def drawn_elevation(rng: np.random.Generator, count: int) -> Floats:
    """(count,) by how much elevations are off [rad], of all kinds."""
    return np.asarray(rng.normal(0.0, _ELEVATION_RAD[rng.choice(len(REGIMES), count, p=_PRIOR)]))


def prior_share(elevation_rad: Floats) -> Floats:
    """(K, N) probability of each kind for particles whose elevations (N,) are off by that much."""
    std = _ELEVATION_RAD[:, None]
    joint = _PRIOR[:, None] / std * np.exp(-0.5 * (elevation_rad / std) ** 2)
    return np.asarray(joint / joint.sum(axis=0))


def changed(share: Floats, apertures: float) -> Floats:
    """(K, N) after so many more: rooms may change on the way."""
    changes = _CHANGES * apertures
    return np.asarray((1.0 - changes) * share + changes * _PRIOR[:, None])


def of_bearing(share: Floats, weight: Floats, found: Floats, fresh: float) -> Floats:
    """(K, N) factor on the joint probability `share` (K, N) times `weight` (N,) of kind and place, of likelihoods
    `found` (K, N) of which a share `fresh` is new. Of the kind of room all of that tells; of the place less, where
    errors last."""
    room = share @ weight
    told = ((share * found) @ weight / room) ** fresh
    return _keeping(share, weight, found ** (_COUNTED * fresh)) * told[:, None]


def of_power(share: Floats, weight: Floats, log_likelihood: Floats) -> Floats:
    """(K, N) the same of received power, (N,), which says nothing of the kind of room."""
    relative = np.maximum(log_likelihood - log_likelihood.max(), _LEAST_LOG)
    return _keeping(share, weight, np.exp(_HEARD * relative))


def _keeping(share: Floats, weight: Floats, factor: Floats) -> Floats:
    """The factor (K, N), scaled for each kind so that its probability stays."""
    return np.asarray(factor * ((share @ weight) / ((share * factor) @ weight))[:, None])
