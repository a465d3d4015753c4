"""The oracle that tracker and NEES are held against: Stone Soup's particle filter of a source that stands, heard by
azimuth and elevation. It is imported where it is used: it takes two seconds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime, timedelta
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.sensing.records import Bearing

Floats = npt.NDArray[np.float64]

_PARTICLES: Final = 8000
_BEGUN: Final = datetime(2026, 1, 1)


class SoupWorld(NamedTuple):
    """What the filter knows: deviations of azimuth (where the source is level) and elevation, by how much a source
    wanders in a second along each axis, and ranges drawn from what is known before anything is heard."""

    azimuth_std_rad: float
    elevation_std_rad: float
    wander_m_sqrt_s: float
    ranges_m: Floats


def state_of(mean_m: Floats, covariance_m2: Floats) -> Any:
    """A Gaussian state of mean (3,) and covariance (3, 3)."""
    from stonesoup.types.state import GaussianState

    return GaussianState(mean_m[:, None], covariance_m2)


def particles_of(places_m: Floats) -> Any:
    """A state of particles (N, 3) that are as likely."""
    from stonesoup.types.array import StateVectors
    from stonesoup.types.state import ParticleState

    return ParticleState(StateVectors(places_m.T), log_weight=np.full(len(places_m), -math.log(len(places_m))))


def nees(belief: Any, truth_m: Floats) -> float:
    """Squared Mahalanobis distance of a truth (3,), as Stone Soup measures it, which is what NEES is. It has no metric
    of that name."""
    from stonesoup.measures import SquaredMahalanobis
    from stonesoup.types.state import State

    return float(SquaredMahalanobis(state_covar_inv_cache_size=0)(belief, State(truth_m[:, None])))


def belief_of(bearings: Sequence[Bearing], world: SoupWorld, seed: int) -> tuple[Floats, Floats]:
    """Mean (3,) and covariance (3, 3) of the filter's particles after all `bearings`."""
    from stonesoup.models.measurement.nonlinear import CartesianToElevationBearing
    from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, RandomWalk
    from stonesoup.predictor.particle import ParticlePredictor
    from stonesoup.resampler.particle import ESSResampler
    from stonesoup.types.angle import Bearing as Azimuth
    from stonesoup.types.angle import Elevation
    from stonesoup.types.array import StateVectors
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import ParticleState
    from stonesoup.updater.particle import ParticleUpdater

    walks = [RandomWalk(world.wander_m_sqrt_s**2, seed=3 * seed + axis) for axis in range(3)]
    predictor = ParticlePredictor(CombinedLinearGaussianTransitionModel(walks))
    updater = ParticleUpdater(None, ESSResampler(threshold=0.5 * _PARTICLES))
    state = ParticleState(
        StateVectors(_first(bearings[0], world, seed).T),
        log_weight=np.full(_PARTICLES, -math.log(_PARTICLES)),
        timestamp=_BEGUN + timedelta(microseconds=bearings[0].t_mono_ns / 1e3),
    )
    with _drawn_from(seed):
        for bearing in bearings[1:]:
            # Our deviation is of the great circle: where a source is high, an azimuth is known less well.
            level = math.sin(bearing.polar_rad)
            model = CartesianToElevationBearing(
                ndim_state=3,
                mapping=(0, 1, 2),
                noise_covar=np.diag([world.elevation_std_rad**2, (world.azimuth_std_rad / level) ** 2]),
                translation_offset=np.array(bearing.p_local_enu_m)[:, None],
            )
            at = _BEGUN + timedelta(microseconds=bearing.t_mono_ns / 1e3)
            angles = np.array([[Elevation(math.pi / 2 - bearing.polar_rad)], [Azimuth(bearing.azimuth_rad)]])
            heard = Detection(angles, timestamp=at, measurement_model=model)
            state = updater.update(SingleHypothesis(predictor.predict(state, timestamp=at), heard))
    return np.asarray(state.mean, float).reshape(3), np.asarray(state.covar, float)


def _first(bearing: Bearing, world: SoupWorld, seed: int) -> Floats:
    """(N, 3) places after the first bearing, which is as likely in all directions."""
    rng = np.random.default_rng([seed, 1])
    polar = bearing.polar_rad + rng.normal(0.0, world.elevation_std_rad, _PARTICLES)
    across = world.azimuth_std_rad / math.sin(bearing.polar_rad)
    azimuth = bearing.azimuth_rad + rng.normal(0.0, across, _PARTICLES)
    units = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=1)
    return np.asarray(np.array(bearing.p_local_enu_m) + rng.choice(world.ranges_m, _PARTICLES)[:, None] * units)


@contextmanager
def _drawn_from(seed: int) -> Iterator[None]:
    """Its resamplers draw from the generator that all of a process share."""
    before = np.random.get_state()  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002
