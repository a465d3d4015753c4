"""What a straight path can tell: a cone about it, and on it no direction before another.

Moving along the unit vector e, the phase knows of a direction u only c = u . e. So with the phase's variance s^2 over
the places x_k = chi_k . e,  var(c) = s^2 (lambda / 2 pi)^2 / sum_k (x_k - mean)^2, and the cone's angle g = arccos c
has the deviation  std(c) / sin g, but for a source ahead, where g ~ sqrt(2 (1 - c)) is known to
sqrt(std(c)) at best.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wsr.aoa import AoaEstimate, Cone
from wsr.aperture import Aperture
from wsr.directions import Peak
from wsr.geometry import angles, direction, great_circle, wrap_angle
from wsr.peaks import MIN_SEPARATION_RAD

# An angle is observable when all of the cone agrees on it within this, and the cone is known as closely.
_OBSERVABLE_RAD = math.radians(10.0)
# An axis this close to the vertical has no left and right.
_UPRIGHT = math.cos(math.radians(5.0))
# Directions closer than this are not listed twice.
_SAME_RAD = math.radians(3.0)
_AROUND = 24

Array = NDArray[np.float64]


def on_cone(
    estimate: AoaEstimate,
    aperture: Aperture,
    places_m: Array,
    variance_rad2: float,
    *,
    wavelength_m: float,
    model_rad: float,
) -> AoaEstimate:
    """The estimate of a straight aperture with its cone, what of it is observable, and the other directions on it.

    `variance_rad2` is of the phase at the places (n, 3), with what its correlation in time adds, `wavelength_m` that of
    the phase (half of the carrier's for the round-trip product), `model_rad` what noise does not show of the cone's
    angle. An angle that is not observable has an infinite variance; of one that is, the cone's spread counts in.
    """
    u = direction(estimate.azimuth_rad, estimate.polar_rad)
    axis = _axis(aperture)
    cosine = float(np.clip(u @ axis, -1.0, 1.0))
    x = places_m @ axis
    spread = float(((x - x.mean()) ** 2).sum())
    cosine_std = math.sqrt(variance_rad2 / spread) * wavelength_m / (2 * math.pi)
    sine = math.sqrt(max(1.0 - cosine**2, cosine_std, 1e-12))
    cone = Cone(
        (float(axis[0]), float(axis[1]), float(axis[2])), math.acos(cosine), math.hypot(cosine_std / sine, model_rad)
    )
    azimuth, polar = (np.asarray(a) for a in angles(np.array([_turned(u, axis, turn) for turn in _turns()])))
    azimuth_off = float(np.abs(wrap_angle(azimuth - estimate.azimuth_rad)).max())
    polar_off = float(np.abs(polar - estimate.polar_rad).max())
    known = cone.angle_std_rad < _OBSERVABLE_RAD
    azimuth_std = math.hypot(cone.angle_std_rad / max(math.sin(estimate.polar_rad), 1e-6), azimuth_off)
    polar_std = math.hypot(cone.angle_std_rad, polar_off)
    azimuth_ok, polar_ok = known and azimuth_off < _OBSERVABLE_RAD, known and polar_off < _OBSERVABLE_RAD
    variances = (azimuth_std**2 if azimuth_ok else math.inf, polar_std**2 if polar_ok else math.inf)
    return replace(
        estimate,
        azimuth_std_rad=math.sqrt(variances[0]),
        polar_std_rad=math.sqrt(variances[1]),
        covariance=((variances[0], 0.0, 0.0), (0.0, variances[1], 0.0), (0.0, 0.0, math.inf)),
        crb_rad=math.inf,
        reliability=estimate.reliability if azimuth_ok else 0.0,
        azimuth_observable=azimuth_ok,
        polar_observable=polar_ok,
        alternatives=_alternatives(estimate, u, axis),
        range_m=None,
        range_std_m=math.inf,
        range_observable=False,
        paths=_off_cone(estimate.paths, axis),
        cone=cone,
    )


def _axis(aperture: Aperture) -> Array:
    """Unit vector (3,) of the path, in the sense of its motion."""
    axis = np.asarray(aperture.principal_axes[0])
    forward = float(aperture.chi_m[-1] @ axis - aperture.chi_m[0] @ axis)
    return axis if forward >= 0.0 else -axis


def _alternatives(estimate: AoaEstimate, u: Array, axis: Array) -> tuple[Peak, ...]:
    """The twin of u (3,) on the other side of the path, if that has sides, then half and quarter turns around it."""
    across = np.array([axis[1], -axis[0], 0.0]) / max(float(np.hypot(axis[0], axis[1])), 1e-12)
    twins = [] if abs(axis[2]) > _UPRIGHT else [u - 2.0 * (u @ across) * across]
    kept, peaks = [u], []
    found = estimate.paths[0]
    for v in (*twins, *(_turned(u, axis, turn) for turn in (math.pi, math.pi / 2, -math.pi / 2))):
        if all(float(great_circle(v, other)) > _SAME_RAD for other in kept):
            azimuth, polar = (float(angle) for angle in angles(v))
            kept.append(v)
            peaks.append(replace(found, azimuth_rad=azimuth, polar_rad=polar))
    return tuple(peaks)


def _off_cone(paths: tuple[Peak, ...], axis: Array) -> tuple[Peak, ...]:
    """The first path and those that are on another cone: along one cone a ridge has chance peaks."""
    cones = [math.acos(float(np.clip(direction(p.azimuth_rad, p.polar_rad) @ axis, -1.0, 1.0))) for p in paths]
    kept: list[int] = []
    for number, angle in enumerate(cones):
        if all(abs(angle - cones[other]) >= MIN_SEPARATION_RAD for other in kept):
            kept.append(number)
    return tuple(paths[number] for number in kept)


def _turned(u: Array, axis: Array, turn_rad: float) -> Array:
    """u (3,) turned about a unit vector (3,): Rodrigues' formula."""
    along = float(u @ axis) * axis
    return np.asarray(along + math.cos(turn_rad) * (u - along) + math.sin(turn_rad) * np.cross(axis, u))


def _turns() -> Array:
    return np.linspace(0.0, 2 * math.pi, _AROUND, endpoint=False)
