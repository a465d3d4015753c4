"""The `robust` estimator: prepare the packets, search direction and range, say how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from wsr.aoa import AoaEstimate, Matrix3
from wsr.aperture import Aperture, spans
from wsr.directions import Peak, Profile
from wsr.drift import Drift, find_drift, turned
from wsr.estimators.arrivals import arrivals
from wsr.estimators.cone import on_cone
from wsr.estimators.description import without_image
from wsr.estimators.options import RobustOptions
from wsr.estimators.preparation import Prepared, prepare, takes_first_path
from wsr.estimators.trust import Evidence, model_error_rad, range_error_m, reliability
from wsr.focus import Bounds, Focus, Look, circle_grid, look, look_around, refine
from wsr.geometry import direction, wrap_angle
from wsr.half_turns import without_half_turns
from wsr.likelihood import matched, most_likely
from wsr.peaks import find_peaks, mirrored
from wsr.pictures import level_profile, look_profile, ring_peaks
from wsr.subapertures import SubApertures, score, sub_apertures
from wsr.uncertainty import bound, phase_variance, time_correlation

# A path in a plane this close to level is searched in azimuth only.
_LEVEL_COSINE = math.cos(math.radians(30.0))
_MIN_EXTENT_WAVELENGTHS = 0.5
_MIN_EXTENT_SHARE = 0.03
# An angle is observable when its bound is below this and both mirror images agree on it as closely; a range when it is
# known to this share of itself and nearer than waves look flat.
_OBSERVABLE_RAD = math.radians(10.0)
_OBSERVABLE_RANGE_SHARE = 0.5
_FAR_M = 60.0
_PATHS = 5
# Mean squares of blocks of residual phases over those of white noise, from where on they are taken to hold a trend.
_TREND = 4.0
_APART_RAD = math.radians(12.0)
# A grid of 3 degrees, so fine that one step is less than anybody minds.
_FINE_STEP_RAD, _FINE_STEPS = math.radians(0.05), 30

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Found:
    """A search over x_m (B, 3), the bins about their centroid; `level`: a horizontal plane, azimuth only. With `drift`
    all of it is of the bins with that phase taken out."""

    look: Look
    focus: Focus
    level: bool
    parts: SubApertures
    x_m: Array
    extents_m: tuple[float, float, float]
    drift: Drift | None
    residual_rad: Array
    """(B,) phases, over all subcarriers, that direction and range leave unexplained."""


@dataclass(frozen=True, slots=True)
class Robust:
    """One-way channels of all subcarriers, focused over direction and range, fused over scales of sub-apertures."""

    options: RobustOptions = field(default_factory=RobustOptions)

    def estimate(self, aperture: Aperture) -> tuple[AoaEstimate, Profile]:
        """The estimate and a picture: the fused score over the sphere, or, of a level path, which has no more to say
        than its azimuths, the far-field power of the channel centre. Raises ApertureError."""
        if not takes_first_path(aperture, self.options):
            aperture = without_half_turns(aperture)
        prepared = prepare(aperture, self.options)
        found = find(prepared, self.options)
        if found.level:
            profile = level_profile(found.x_m, prepared.bins.channel.mean(axis=1), prepared.wavelength_m)
            paths = ring_peaks(found.look, _PATHS)
        else:
            profile = look_profile(found.look)
            paths = find_peaks(profile, _PATHS)
        return _described(aperture, prepared, found, paths, options=self.options), profile


def find(prepared: Prepared, options: RobustOptions) -> Found:
    """Where the score is highest."""
    bins, wavelength_m = prepared.bins, prepared.wavelength_m
    x = bins.p_m - bins.p_m.mean(axis=0)
    axes = np.linalg.svd(x.T @ x)[2]
    extents = np.sort(spans(x, axes))[::-1]
    flat = extents[2] < max(_MIN_EXTENT_WAVELENGTHS * wavelength_m, _MIN_EXTENT_SHARE * extents[0])
    level = bool(flat and abs(axes[2, 2]) > _LEVEL_COSINE)
    if level:
        # What is left of height there is the tracker's drift.
        x = x - np.outer(x @ axes[2], axes[2])
    fused = sub_apertures(
        x,
        bins.channel,
        bins.segment,
        wavelength_m,
        scales=options.scales,
        resign=options.resign,
        share=options.power_share,
        grid=prepared.grid,
    )
    ranges_m: tuple[float | None, ...] = options.ranges_m if options.focus else (None,)

    def searched(parts: SubApertures, nearer_m: tuple[float, ...] = ()) -> Look:
        if level:
            circles = circle_grid(options.step_rad, options.planar_polars_rad)
            return look_around(parts, circles, (*nearer_m, *ranges_m), options.delay_ns)
        return look(parts, options.step_rad, (*nearer_m, *ranges_m), options.delay_ns)

    lean = fused.condensed()
    seen = searched(lean)
    beam_rad = wavelength_m / float(extents[0])
    bounds = Bounds(options.min_planar_polar_rad, math.pi / 2, True) if level else Bounds()
    focus = _climbed(lean, seen, bounds, beam_rad, options=options)
    nearer_m = options.near_ranges_m if options.focus and _may_be_nearer(focus, seen) else ()
    if nearer_m:
        nearer = searched(lean, nearer_m)
        from_near = _climbed(lean, nearer, bounds, beam_rad, options=options)
        is_near = from_near.range_m is not None and from_near.range_m < nearer_m[-1] * math.sqrt(2.0)
        if is_near and from_near.coherence > options.coherent_above:
            seen, focus = nearer, from_near
        else:
            nearer_m = ()
    drift, left = None, matched(fused, x, bins.segment, focus)
    if options.drift and (level or not flat) and time_correlation(np.angle(left)) > _TREND:
        starts = [(focus.azimuth_rad, focus.polar_rad), _elsewhere(seen, focus)]
        drift = find_drift(fused, prepared.bin_t_s, focus, starts, ranges_m=ranges_m, beam_rad=beam_rad, bounds=bounds)
    if drift is not None:
        fused, focus = turned(fused, drift.tau, drift.turns), drift.focus
        seen, left = searched(fused.condensed(), nearer_m), matched(fused, x, bins.segment, focus)
    if not level and focus.coherence > options.coherent_above:
        focus = most_likely(
            fused, x, bins.segment, bins.counts, focus=focus, nuisance=None if drift is None else drift.tau
        )
        left = matched(fused, x, bins.segment, focus)
    sizes = float(extents[0]), float(extents[1]), float(extents[2])
    return Found(
        look=seen,
        focus=focus,
        level=level,
        parts=fused,
        x_m=x,
        extents_m=sizes,
        drift=drift,
        residual_rad=np.angle(left),
    )


def _climbed(fused: SubApertures, seen: Look, bounds: Bounds, beam_rad: float, *, options: RobustOptions) -> Focus:
    """The best of the maxima above the highest cell of each range.

    A coarse cell of the wrong range can be the highest, and its climb end on a side lobe. Maxima are compared by their
    fused scores, or, once one of them adds up coherently, by coherence.
    """
    cells: dict[int, int] = {}
    for r, at in enumerate(np.argmax(seen.combined, axis=0)):
        best_r = cells.setdefault(int(at), r)
        if seen.combined[at, r] > seen.combined[at, best_r]:
            cells[int(at)] = r
    found = []
    for at, r in cells.items():
        start = float(seen.azimuth_rad[at]), float(seen.polar_rad[at]), seen.ranges_m[r]
        found.append(
            refine(
                fused, start, seen.peak, options.step_rad, beam_rad=beam_rad, bounds=bounds,
                delay_ns=options.delay_ns, coherent_above=options.coherent_above, steps=options.refine_steps,
            )
        )  # fmt: skip
    best = max(found, key=lambda focus: focus.coherence)
    if best.coherence > options.coherent_above:
        return best

    def fused_score(focus: Focus) -> float:
        u = direction(focus.azimuth_rad, focus.polar_rad)[None, :]
        return float((score(fused, u, (focus.range_m,), options.delay_ns).score[:, 0, 0] / seen.peak).mean())

    best = max(found, key=fused_score)
    return best if bounds.planar else _settled(fused, seen, best, options)


def _may_be_nearer(focus: Focus, seen: Look) -> bool:
    """The nearest of the ranges that were looked at fits best, or a nearer one."""
    nearest_m = seen.ranges_m[0]
    is_nearer = focus.range_m is not None and nearest_m is not None and focus.range_m < nearest_m
    return is_nearer or int(np.argmax(seen.combined.max(axis=0))) == 0


def _settled(fused: SubApertures, seen: Look, focus: Focus, options: RobustOptions) -> Focus:
    """The best of a fixed grid of directions around a focus, at its range.

    Where nothing adds up coherently the score has edges, since signs are chosen anew in every direction, and a climb
    ends where its steps happen to lead: micrometres of the path would move it by half a degree.
    """
    around = _FINE_STEP_RAD * np.arange(-_FINE_STEPS, _FINE_STEPS + 1)
    azimuths = _FINE_STEP_RAD * round(focus.azimuth_rad / _FINE_STEP_RAD) + around
    polars = _FINE_STEP_RAD * round(focus.polar_rad / _FINE_STEP_RAD) + around
    azimuth, polar = (axis.ravel() for axis in np.meshgrid(azimuths, polars[(polars > 0.0) & (polars < math.pi)]))
    scores = score(fused, direction(azimuth, polar), (focus.range_m,), options.delay_ns)
    at = int(np.argmax((scores.score[:, :, 0] / seen.peak[:, None]).mean(axis=0)))
    return Focus(float(azimuth[at]), float(polar[at]), focus.range_m, float(scores.coherence[0, at, 0]))


def _elsewhere(seen: Look, focus: Focus) -> tuple[float, float]:
    """The best direction of a look that is not the focus's."""
    near = seen.units @ direction(focus.azimuth_rad, focus.polar_rad)
    at = int(np.argmax(np.where(near < math.cos(_APART_RAD), seen.power, 0.0)))
    return float(seen.azimuth_rad[at]), float(seen.polar_rad[at])


def _described(
    aperture: Aperture, prepared: Prepared, found: Found, peaks: tuple[Peak, ...], *, options: RobustOptions
) -> AoaEstimate:
    focus, dimension, residual = found.focus, aperture.dimension, found.residual_rad
    inverse = bound(
        found.x_m,
        prepared.wavelength_m,
        focus.azimuth_rad,
        focus.polar_rad,
        range_m=focus.range_m,
        level=found.level,
        nuisance=None if found.drift is None else found.drift.tau,
    )
    if dimension == 1:
        inverse = np.diag(np.full(3, math.inf))
    unit = phase_variance(residual) * inverse
    best = _reported(focus, peaks)
    image = mirrored(best, aperture.principal_axes[2]) if dimension == 2 else None
    rivals = peaks[1:] if image is None else without_image(peaks[1:], image, None)
    evidence = Evidence(
        coherence=math.sqrt(min(focus.coherence, 1.0)),
        rival=rivals[0].relative_power if rivals else 0.0,
        length_wavelengths=found.extents_m[0] / prepared.wavelength_m,
    )
    inflation = time_correlation(residual)
    covariance = _covariance(unit, inflation, model_error_rad(evidence), focus.polar_rad)
    covariance[2, 2] += range_error_m(evidence, len(residual) * float(inverse[2, 2])) ** 2
    azimuth_std, polar_std, range_std = (math.sqrt(v) for v in np.diag(covariance))
    # By the geometry and its noise. An answer that multipath makes vague is still one, with a deviation that says so.
    azimuth_bound, polar_bound = (math.sqrt(inflation * v) for v in np.diag(unit)[:2])
    azimuth_ok = azimuth_bound < _OBSERVABLE_RAD and dimension > 1
    polar_ok = polar_bound < _OBSERVABLE_RAD and dimension > 1 and not found.level
    if image is not None:
        azimuth_ok &= abs(float(wrap_angle(best.azimuth_rad - image.azimuth_rad))) < _OBSERVABLE_RAD
        polar_ok &= abs(best.polar_rad - image.polar_rad) < _OBSERVABLE_RAD
    range_m = focus.range_m if focus.range_m is not None and focus.range_m < _FAR_M else None
    # The curvature of the wavefront shows over the whole aperture only, and only if most of the power adds up over it.
    range_ok = range_m is not None and range_std < _OBSERVABLE_RANGE_SHARE * range_m and focus.coherence > 0.5
    weights = prepared.bins.weights / prepared.bins.weights.sum()
    x, y, z = (float(v) for v in np.array(aperture.reference_p_m) + weights @ aperture.chi_m)
    estimate = AoaEstimate(
        azimuth_rad=best.azimuth_rad,
        polar_rad=best.polar_rad,
        azimuth_std_rad=azimuth_std,
        polar_std_rad=polar_std,
        covariance=_matrix3(covariance),
        crb_rad=_great_circle(unit, focus.polar_rad, found.level),
        coherence=evidence.coherence,
        reliability=reliability(evidence),
        azimuth_observable=azimuth_ok,
        polar_observable=polar_ok,
        alternatives=() if image is None else (image,),
        packets=aperture.packets - sum(prepared.dropped.values()),
        length_m=aperture.length_m,
        extents_m=aperture.extents_m,
        reference_p_m=(x, y, z),
        reference_t_s=float(weights @ aperture.t_s),
        range_m=range_m if range_ok else None,
        range_std_m=range_std,
        range_observable=range_ok,
        paths=arrivals(
            prepared, options, found.parts, found.x_m, focus=focus, level=found.level, first=best, count=_PATHS
        ),
        dropped=prepared.dropped,
        drift_turns=0.0 if found.drift is None else found.drift.turns,
    )
    if dimension > 1:
        return estimate
    noise = phase_variance(residual) * inflation
    return on_cone(
        estimate, aperture, found.x_m, noise, wavelength_m=prepared.wavelength_m, model_rad=model_error_rad(evidence)
    )


def _reported(focus: Focus, paths: tuple[Peak, ...]) -> Peak:
    """The highest peak of the look, moved to where the refinement found it."""
    top = paths[0]
    azimuth = float(wrap_angle(focus.azimuth_rad))
    return Peak(
        azimuth_rad=azimuth,
        polar_rad=focus.polar_rad,
        power=focus.coherence,
        relative_power=1.0,
        prominence=top.prominence,
        width_rad=top.width_rad,
    )


def _great_circle(unit: Array, polar_rad: float, level: bool) -> float:
    """Bound as an angle on the sphere; along the circle of azimuths where only these were searched."""
    polar = 0.0 if level and math.isfinite(unit[0, 0]) else float(unit[1, 1])
    return math.sqrt(polar + math.sin(polar_rad) ** 2 * float(unit[0, 0]))


def _covariance(unit: Array, inflation: float, model_rad: float, polar_rad: float) -> Array:
    """Bound at the noise seen, times its correlation in time, plus what the model misses on top of it."""
    result = unit * inflation
    result[0, 0] += (model_rad / max(math.sin(polar_rad), 1e-6)) ** 2
    result[1, 1] += model_rad**2
    return np.asarray(result)


def _matrix3(matrix: Array) -> Matrix3:
    a, b, c = ((float(row[0]), float(row[1]), float(row[2])) for row in matrix)
    return a, b, c
