"""MUSIC on stretches of the path, with subcarriers as snapshots and the number of sources by MDL.

What a snapshot is. An aperture flown once sees each place once, so the only repeats of one spatial vector are the
subcarriers: X (p, S), p places and S columns. Paths of different delay change phase against each other over the
subcarriers, which is what gives their covariance a rank above one, although 17.5 MHz leave it far from full: two paths
20 ns apart have correlation 0.8. The noise of subcarriers is independent. Columns are comparable only if

- every packet is free of its own detection delay (otherwise one path already spans several dimensions). Through the
  power centroid that works for one path; for more, each packet's delay is fitted so that all packets together have
  least energy outside r dimensions of delay, for r = 1, 2, ... until MDL finds no more than r sources;
- the field is linear in the paths. The product of forward and reverse channel is not: of two paths a and b it holds
  a^2, b^2 and 2 a b, whose direction halfway between them is the strongest and is where nobody is. So this estimator
  works on the one-way channel h, h^2 = H_f H_r (`wsr.reciprocity`), with 2 pi / lambda. Its sign has to hold only
  within a stretch, and the turnaround jitter is taken out by half its phase.

What spatial smoothing is. Stretches of an arbitrary path are no translated copies of each other, so their covariances
must not be averaged: the same direction has another steering vector in each. (Forward-backward averaging needs an array
that is its own mirror image, and interpolated arrays need stretches of one orientation; a path in space has neither.)
Here each stretch b of p places, half overlapping the next, keeps its own steering vectors a_b and signal subspace E_b,
and the spectra are multiplied:

    d_b(u) = 1 - |E_b^H a_b(u)|^2 / p,        F(u) ~ prod_b 1 / (d_b(u) + floor)

which is the likelihood of stretches whose noise levels are unknown and differ; the floor keeps one stretch from
overruling the rest. Paths that are wholly coherent leave one dimension per stretch, a mixture that differs from stretch
to stretch; the product still peaks at both. Nothing is coherent across stretches, so slow drift of the pose does
little harm, and noise counts for more than in one coherent sum.

Number of sources (Wax and Kailath 1985), with the likelihood ratio of each stretch, the count common to all, and the
effective number of snapshots N = S (1 - r) / (1 + r), r the correlation of what lies beyond the largest count between
neighbouring subcarriers:

    MDL(k) = sum_b [-N (p - k) log(geometric / arithmetic mean of the p - k smallest eigenvalues)
                     + k (2p - k) / 2 log N]

MDL counts whatever stands out of white noise, and on recordings errors of the model do too: there it is always at its
limit. Over a bandwidth B, delays that spread over T leave 1 + B T dimensions; 17.5 MHz and the 60 ns of rooms make that
two, which is the default limit. So whether what MDL counts are paths is asked again of plane waves fitted to the
snapshots (`path_number`), and the spectrum is that of the paths confirmed. In the reliability a peak that is no path
still counts as a rival.

Without subcarriers there is one snapshot: E_b is that vector, one source is assumed, and what is left is the product
of the stretches' Bartlett spectra, on the round-trip product, whose sign is known. The same where packets are so far
apart that the signs of the one-way channel cannot be chained.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wsr.aoa import AoaEstimate
from wsr.aperture import MIN_PACKETS, Aperture
from wsr.channel import bounded_amplitude
from wsr.directions import AZIMUTH_RAD, POLAR_RAD, Peak, Profile
from wsr.errors import ApertureError
from wsr.estimators.description import describe, is_horizontal
from wsr.estimators.source_number import path_number, source_number
from wsr.estimators.stretches import MIN_PLACES, Stretch, cut, likeness, path_powers, whole_coherence
from wsr.estimators.trust import Evidence
from wsr.geometry import angles, direction, perpendicular
from wsr.half_turns import without_half_turns
from wsr.kernel import bartlett_power
from wsr.path_bins import Bins, path_bins
from wsr.peaks import MIN_SEPARATION_RAD, find_peaks, mirrored
from wsr.reciprocity import ChainLimits, chain, fold, without_delay
from wsr.turnaround import carrier_offset_hz, jitter_s

_ALIGNMENT_STEPS = 10
# A stretch that fits a direction better than this tells of its few snapshots, not of the direction.
_FLOOR = 0.01
# A packet of less than this share of the strongest one's power has no signal: 90 dB are more than any radio spans.
_SILENT = 1e-9
# Directions whose steering vectors agree so far are one to this aperture: mirror images, or a cone's.
_SAME = 0.9
_REFINEMENT_RAD = tuple(math.radians(step) for step in (0.5, 0.5, 0.25, 0.25, 0.1, 0.1, 0.05, 0.02))
_SCATTER_STEP_RAD = math.radians(0.25)

# 3 x 3 neighbours, and the least-squares parabola through them: c + bx x + by y + cxx x^2 + cxy x y + cyy y^2.
_X, _Y = (axis.ravel() for axis in np.meshgrid((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0)))
_PARABOLA = np.linalg.pinv(np.stack([np.ones(9), _X, _Y, _X * _X, _X * _Y, _Y * _Y], axis=1))

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Music:
    """Places are `bin_wavelengths` apart, `elements` of them make a stretch, at most `max_sources` are told apart and
    never more than half of the places.

    Longer stretches resolve more, shorter ones bear more drift: 16 places are 3 wavelengths, a lobe of 18 degrees.
    """

    elements: int = 16
    bin_wavelengths: float = 0.2
    max_sources: int = 2
    min_separation_rad: float = MIN_SEPARATION_RAD

    def estimate(self, aperture: Aperture) -> tuple[AoaEstimate, Profile]:
        """The estimate and the spectrum it was read from, scaled to the power of the reported peak."""
        given = aperture.packets
        aperture, turn = _without_turnaround_jitter(without_half_turns(_heard(aperture)))
        has_subcarriers = aperture.grid.size > 1
        found = self._from_subcarriers(aperture, turn) if has_subcarriers else None
        bins, stretches, sources = found or self._from_centre(aperture)
        wave_m = aperture.wavelength_m if found else aperture.wavelength_m / 2
        distance = mean_log_distance(stretches, sources)
        peaks = self._peaks(stretches, sources, distance)
        rival = peaks[1].relative_power if len(peaks) > 1 else 0.0
        paths = path_number(stretches, _directions(peaks))
        if paths < sources:
            sources = paths
            distance = mean_log_distance(stretches, sources)
            peaks = self._peaks(stretches, sources, distance)
        best, mirror = _choose(aperture, peaks[0])
        u = direction(best.azimuth_rad, best.polar_rad)
        evidence = Evidence(
            coherence=math.sqrt(min(whole_coherence(bins, u, wave_m), 1.0)),
            rival=rival,
            length_wavelengths=aperture.extents_m[0] / wave_m,
        )
        channel = bounded_amplitude(aperture.channel)
        estimate = describe(aperture, channel, best, mirror, others=peaks[1:], evidence=evidence)
        power = best.power * np.exp(distance.min() - distance)
        reference_p_m, reference_t_s = _reference(aperture, bins)
        return replace(
            _with_scatter(estimate, stretches, sources),
            reference_p_m=reference_p_m,
            reference_t_s=reference_t_s,
            dropped={"no signal": given - aperture.packets} if aperture.packets < given else {},
        ), Profile(power.astype(np.float32), AZIMUTH_RAD, POLAR_RAD)

    def _from_subcarriers(self, aperture: Aperture, turn: Complex) -> tuple[Bins, list[Stretch], int] | None:
        """None where the chain of signs breaks so often that no piece of it makes a stretch."""
        field = one_way_field(aperture) * turn[:, None]
        wave = aperture.wavelength_m
        sign, keep, segment = chain(
            field, aperture.t_s, aperture.chi_m, ChainLimits(wave / 3, wave / 12, gate=False), grid=aperture.grid
        )
        field = field * sign[:, None]
        for rank in range(1, self.max_sources + 1):
            # Each time from the start: what was fitted to fewer responses is a bad place to fit more from.
            bins = path_bins(
                aperture.chi_m,
                aligned(field, rank, keep, aperture.grid.k),
                keep,
                segment,
                length_m=self.bin_wavelengths * wave,
            )
            if np.bincount(bins.segment).max() < MIN_PLACES:
                return None
            stretches = cut(bins, self.elements, wave)
            sources = source_number(stretches, self.max_sources)
            if sources <= rank:
                break
        return bins, stretches, sources

    def _from_centre(self, aperture: Aperture) -> tuple[Bins, list[Stretch], int]:
        wave = aperture.wavelength_m / 2
        channel = bounded_amplitude(aperture.channel)[:, None]
        keep, segment = np.ones(aperture.packets, np.bool_), np.zeros(aperture.packets, np.int64)
        bins = path_bins(aperture.chi_m, channel, keep, segment, length_m=self.bin_wavelengths * wave)
        return bins, cut(bins, self.elements, wave), 1

    def _peaks(self, stretches: list[Stretch], sources: int, distance: Array) -> tuple[Peak, ...]:
        """Peaks of the spectrum between grid points, as many as there are sources, by their power."""
        spectrum = Profile(np.exp(distance.min() - distance).astype(np.float32), AZIMUTH_RAD, POLAR_RAD)
        chosen: list[Peak] = []
        directions: list[Array] = []
        for peak in find_peaks(spectrum, 2 + 2 * sources, self.min_separation_rad):
            u = refined(stretches, sources, direction(peak.azimuth_rad, peak.polar_rad))
            if all(likeness(stretches, u, other) < _SAME for other in directions):
                azimuth, polar = angles(u)
                chosen.append(replace(peak, azimuth_rad=float(azimuth), polar_rad=float(polar)))
                directions.append(u)
            if len(chosen) == sources:
                break
        powers = path_powers(stretches, np.array(directions)).tolist()
        strongest = max(*powers, 1e-12)
        paths = [
            replace(peak, power=power, relative_power=power / strongest, prominence=peak.prominence * power)
            for peak, power in zip(chosen, powers, strict=True)
        ]
        return tuple(sorted(paths, key=lambda path: -path.power))


def one_way_field(aperture: Aperture) -> Complex:
    """h (M, S) of unknown sign for each packet, with h^2 ~ H_f H_r and its delay's centroid taken out.

    Its amplitude is the geometric mean of both directions': how two paths fade belongs to the field.
    """
    if aperture.forward is None or aperture.reverse is None:
        raise ApertureError("aperture has no channels of single subcarriers; expected forward and reverse")
    ahead, back = (np.asarray(csi, np.complex128) for csi in (aperture.forward, aperture.reverse))
    amplitude = np.sqrt(np.linalg.norm(ahead, axis=1) * np.linalg.norm(back, axis=1))
    field = fold(aperture.forward, aperture.reverse, aperture.grid).channel
    return np.asarray(
        without_delay(field, grid=aperture.grid) * (amplitude / max(float(np.median(amplitude)), 1e-300))[:, None]
    )


def aligned(field: Complex, rank: int, keep: NDArray[np.bool_], k_all: Array) -> Complex:
    """The field (M, S) at frequencies k (S,) with a delay per packet that brings all of them closest to `rank` common
    responses (S,).

    Alternates between the responses (dominant right singular vectors of all packets) and, for each packet, a
    least-squares step of its phase slope towards its projection on them.
    """
    for _ in range(_ALIGNMENT_STEPS):
        _, responses = np.linalg.eigh(field[keep].T @ field[keep].conj())
        basis = responses[:, -rank:]
        ratio = field * ((field @ basis.conj()) @ basis.T).conj()
        weight = np.abs(ratio)
        total = np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
        k = k_all - (weight * k_all).sum(axis=1, keepdims=True) / total
        phase = np.angle(ratio * ratio.sum(axis=1, keepdims=True).conj())
        slope = (weight * k * phase).sum(axis=1) / np.maximum((weight * k**2).sum(axis=1), 1e-300)
        field = field * np.exp(-1j * slope[:, None] * k_all)
    return field


def mean_log_distance(stretches: list[Stretch], sources: int) -> Array:
    """Mean over stretches of log(d_b(u) + floor) on the one-degree grid (180, 360)."""
    total = np.zeros((POLAR_RAD.size, AZIMUTH_RAD.size))
    for stretch in stretches:
        p = len(stretch.p_waves)
        share = np.zeros(total.shape, np.float32)
        for column in range(sources):
            share += bartlett_power(stretch.p_waves, stretch.eigenvectors[:, column] / math.sqrt(p))
        total += np.log(np.maximum(1.0 - share, 0.0) + _FLOOR)
    return total / len(stretches)


def refined(stretches: list[Stretch], sources: int, u: Array) -> Array:
    """Direction (3,) of the spectrum's maximum near u, by parabolas through 3 x 3 directions, closer each time."""
    for step in _REFINEMENT_RAD:
        east, north = perpendicular(u)
        around = _around(u, step * east, step * north)
        values = -_distances(stretches, sources, around).mean(axis=0)
        _, bx, by, cxx, cxy, cyy = _PARABOLA @ values
        hessian = np.array([[2 * cxx, cxy], [cxy, 2 * cyy]])
        move = np.array([_X[values.argmax()], _Y[values.argmax()]])
        if np.linalg.eigvalsh(hessian).max() < -1e-12:
            move = np.clip(-np.linalg.solve(hessian, [bx, by]), -2.0, 2.0)
        moved = u + step * (move[0] * east + move[1] * north)
        moved /= np.linalg.norm(moved)
        candidates = np.vstack([moved[None, :], around])
        u = candidates[np.argmin(_distances(stretches, sources, candidates).mean(axis=0))]
    return u


def _heard(aperture: Aperture) -> Aperture:
    """The packets that have a signal at both ends; of the others the phase is the noise's. Raises ApertureError."""
    power = np.abs(aperture.channel)
    if aperture.forward is not None and aperture.reverse is not None:
        power = np.linalg.norm(aperture.forward, axis=1) * np.linalg.norm(aperture.reverse, axis=1)
    heard = power > _SILENT * float(power.max())
    count = int(np.count_nonzero(heard))
    if count == aperture.packets:
        return aperture
    if count < MIN_PACKETS:
        raise ApertureError(f"only {count} of {aperture.packets} packets have a signal; needs at least {MIN_PACKETS}")
    return replace(
        aperture,
        t_s=aperture.t_s[heard],
        chi_m=aperture.chi_m[heard],
        channel=aperture.channel[heard],
        forward=None if aperture.forward is None else aperture.forward[heard],
        reverse=None if aperture.reverse is None else aperture.reverse[heard],
        nic_us=None if aperture.nic_us is None else aperture.nic_us[heard],
    )


def _without_turnaround_jitter(aperture: Aperture) -> tuple[Aperture, Complex]:
    """The aperture with its product freed of the turnaround jitter, and exp(j pi df dt) (M,) for the one-way field."""
    if aperture.nic_us is None:
        return aperture, np.ones(aperture.packets, np.complex128)
    ours_s, theirs_s = aperture.nic_us.T * 1e-6
    offset_hz = carrier_offset_hz(aperture.channel, theirs_s - ours_s, ours_s, aperture.wavelength_m)
    half = np.exp(1j * np.pi * offset_hz * jitter_s(theirs_s - ours_s, ours_s, offset_hz, aperture.wavelength_m))
    return replace(aperture, channel=aperture.channel * half**2), half


def _distances(stretches: list[Stretch], sources: int, directions: Array) -> Array:
    """log(d_b + floor) (B, n) of each stretch at directions (n, 3)."""
    result = np.empty((len(stretches), len(directions)))
    for row, stretch in zip(result, stretches, strict=True):
        steering = np.exp(2j * np.pi * (stretch.p_waves @ directions.T))
        share = (np.abs(stretch.eigenvectors[:, :sources].conj().T @ steering) ** 2).sum(axis=0) / len(steering)
        row[:] = np.log(np.maximum(1.0 - share, 0.0) + _FLOOR)
    return result


def _directions(peaks: tuple[Peak, ...]) -> Array:
    """Unit vectors (n, 3)."""
    return direction([peak.azimuth_rad for peak in peaks], [peak.polar_rad for peak in peaks])


def _choose(aperture: Aperture, peak: Peak) -> tuple[Peak, Peak | None]:
    """The peak to report and its mirror image through the plane of a planar aperture. Which of the two the spectrum has
    higher says nothing; over a horizontal plane the upper one is reported."""
    if aperture.dimension != 2:
        return peak, None
    normal = aperture.principal_axes[2]
    image = mirrored(peak, normal)
    if is_horizontal(normal) and image.polar_rad < peak.polar_rad:
        return image, peak
    return peak, image


def _with_scatter(estimate: AoaEstimate, stretches: list[Stretch], sources: int) -> AoaEstimate:
    """The estimate with the scatter of the stretches added to its covariance.

    One coherent sum's bound is too small for stretches fused in power. What the stretches themselves say is the
    sandwich H^-1 (sum_b g_b g_b^T) H^-1, with g_b the slope of log d_b at the maximum and H the curvature of their sum,
    twice because neighbours overlap by half.
    """
    count = len(stretches)
    u = direction(estimate.azimuth_rad, estimate.polar_rad)
    east = np.array([-math.sin(estimate.azimuth_rad), math.cos(estimate.azimuth_rad), 0.0])
    south = direction(estimate.azimuth_rad, estimate.polar_rad + math.pi / 2)
    step = _SCATTER_STEP_RAD
    fits = _distances(stretches, sources, _around(u, step * east, step * south)) @ _PARABOLA.T
    slopes = fits[:, 1:3] / step
    cxx, cxy, cyy = fits[:, 3:].sum(axis=0) / step**2
    values, axes = np.linalg.eigh(np.array([[2 * cxx, cxy], [cxy, 2 * cyy]]))
    # Where the sum hardly curves, the stretches say nothing; the bound tells then whether the geometry does.
    curved = values > 1e-3 * max(float(values.max()), 1e-300)
    inverse = (axes[:, curved] / values[curved]) @ axes[:, curved].T
    scatter = 2 * count / max(count - 2, 1) * inverse @ (slopes.T @ slopes) @ inverse
    scale = np.diag([1.0 / max(math.sin(estimate.polar_rad), 1e-6), 1.0])
    both = np.array(estimate.covariance)
    both[:2, :2] += scale @ scatter @ scale
    if not np.isfinite(both[0, 0] + both[1, 1]):
        both[0, 1] = both[1, 0] = 0.0
    (a, b, c), (d, e, f), (g, h, i) = both.tolist()
    return replace(
        estimate,
        azimuth_std_rad=math.sqrt(a),
        polar_std_rad=math.sqrt(e),
        covariance=((a, b, c), (d, e, f), (g, h, i)),
    )


def _around(u: Array, x: Array, y: Array) -> Array:
    """Directions (9, 3) around u, by steps x and y (3,) to either side."""
    around = u + _X[:, None] * x + _Y[:, None] * y
    return np.asarray(around / np.linalg.norm(around, axis=1, keepdims=True))


def _reference(aperture: Aperture, bins: Bins) -> tuple[tuple[float, float, float], float]:
    """Point and time: every place counts alike, however many packets were heard there."""
    weights = bins.weights / bins.weights.sum()
    x, y, z = (float(value) for value in np.array(aperture.reference_p_m) + weights @ aperture.chi_m)
    return (x, y, z), float(weights @ aperture.t_s)
