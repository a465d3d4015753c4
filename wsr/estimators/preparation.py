"""From packets to bins of the path: jitter, one-way channel, signs, gates, bins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wsr.aperture import MIN_LENGTH_WAVELENGTHS, MIN_PACKETS, Aperture, spans
from wsr.channel import bounded_amplitude
from wsr.errors import ApertureError
from wsr.estimators.options import RobustOptions
from wsr.first_path import first_path, is_wide
from wsr.half_turns import half_jitter_rad
from wsr.middle import median
from wsr.ofdm import Grid, known
from wsr.path_bins import Bins, path_bins
from wsr.reciprocity import ChainLimits, Folded, chain, chain_quarters, fold, without_delay
from wsr.turnaround import carrier_offset_hz, jitter_s

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Complex = NDArray[np.complex128]
Complex64 = NDArray[np.complex64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Prepared:
    """Bins of the path with their channels, the wavelength of their phase, and what was left out."""

    bins: Bins
    grid: Grid
    """Of the bins' channels."""
    wavelength_m: float
    dropped: dict[str, int]
    bin_t_s: Array
    """(B,) mean time of each bin."""
    amplitude: Array32
    """(M,) of the one-way channel over that of the median packet."""


def prepare(aperture: Aperture, options: RobustOptions) -> Prepared:
    """From packets to bins: jitter, one-way channel, signs, gates, bins. Raises ApertureError if too little is left."""
    folded = _folded(aperture)
    agreement = folded.reciprocity
    by_delay = takes_first_path(aperture, options)
    if by_delay and aperture.half_turns:
        jitter_rad = 2 * half_jitter_rad(aperture, folded.centre)
    else:
        jitter_rad = _jitter_phase(aperture, folded.centre, options)
    clock_s = aperture.t_s if aperture.nic_us is None else (aperture.nic_us[:, 0] - aperture.nic_us[0, 0]) * 1e-6
    keep = np.ones(aperture.packets, np.bool_)
    segment, sign = np.zeros(aperture.packets, np.int64), np.ones(aperture.packets, np.float32)
    if options.reciprocity:
        keep &= agreement > options.min_reciprocity
    disagree = int(np.count_nonzero(~keep))
    wavelength_m = aperture.wavelength_m
    if options.one_way:
        channel = without_delay(folded.channel, jitter_rad / 2, aperture.grid)
        if by_delay:
            channel = first_path(channel, aperture.grid)
        used = np.flatnonzero(keep)
        limits = ChainLimits(
            far_m=options.far_wavelengths * wavelength_m,
            near_m=options.near_wavelengths * wavelength_m,
            gate=options.gate,
        )
        grid = known(1) if by_delay else aperture.grid
        if by_delay and aperture.half_turns:
            # The four roots, told by one path alone: where echoes fade, all together do not tell them.
            quarters, fits, number = chain_quarters(
                channel[used], clock_s[used], aperture.chi_m[used], limits, grid=grid
            )
            channel[used] *= np.power(1j, quarters)[:, None].astype(np.complex64)
        else:
            signs, fits, number = chain(channel[used], clock_s[used], aperture.chi_m[used], limits, grid=grid)
            sign[used] = signs
        keep[used] = fits
        segment[used] = number
    else:
        channel = without_delay(_product(aperture), jitter_rad, aperture.grid)
        wavelength_m = wavelength_m / 2
    if not options.wideband:
        channel = channel.mean(axis=1, keepdims=True)
    came = np.abs(channel[:, 0]) * folded.amplitude if by_delay else folded.amplitude
    amplitude = came / max(median(came), 1e-12)
    channel = _levelled(channel, sign * counted_amplitude(amplitude, options))
    _check_kept(aperture, keep)
    length_m = options.bin_wavelengths * aperture.wavelength_m if options.path_bins else None
    bins = path_bins(aperture.chi_m, channel, keep, segment, length_m=length_m)
    unfit = aperture.packets - int(np.count_nonzero(keep)) - disagree
    dropped = {"ends disagree": disagree, "phase step": unfit}
    return Prepared(
        bins=bins,
        grid=aperture.grid if options.wideband and not by_delay else known(1),
        wavelength_m=wavelength_m,
        dropped={reason: count for reason, count in dropped.items() if count},
        bin_t_s=bins.means(aperture.t_s),
        amplitude=amplitude,
    )


def takes_first_path(aperture: Aperture, options: RobustOptions) -> bool:
    """Whether the band is wide enough, and known enough, to leave out what comes later."""
    return bool(
        options.first_path
        and options.one_way
        and options.wideband
        and aperture.forward is not None
        and is_wide(aperture.grid)
    )


def _check_kept(aperture: Aperture, keep: NDArray[np.bool_]) -> None:
    """Raises ApertureError if too few packets are left, or those left span too little where all together did not."""
    kept = f"{np.count_nonzero(keep)} of {aperture.packets} packets are consistent"
    if np.count_nonzero(keep) < MIN_PACKETS:
        raise ApertureError(f"only {kept}; needs at least {MIN_PACKETS}")
    if keep.all():
        return
    span_m = float(spans(aperture.chi_m[keep], aperture.principal_axes).max())
    needed_m = MIN_LENGTH_WAVELENGTHS * aperture.wavelength_m
    if span_m < needed_m <= aperture.extents_m[0]:
        raise ApertureError(f"only {kept}, which span {span_m:.3f} m; needs at least {needed_m:.3f} m")


def _folded(aperture: Aperture) -> Folded:
    """Without both directions the root of the product, which is then all there is."""
    if aperture.forward is not None and aperture.reverse is not None:
        return fold(aperture.forward, aperture.reverse, aperture.grid)
    centre = _product(aperture)[:, 0].astype(np.complex64)
    root = np.sqrt(centre / max(float(np.abs(centre).mean()), 1e-30))
    return Folded(root[:, None], np.ones(aperture.packets, np.float32), centre, np.abs(root))


def _product(aperture: Aperture) -> Complex:
    """(M, S), the largest of them 1: what is squared later on fits float32 in any unit."""
    product = aperture.channel[:, None]
    if aperture.forward is not None and aperture.reverse is not None:
        product = aperture.forward.astype(np.complex128) * aperture.reverse
    return np.asarray(product / max(float(np.abs(product).max()), 1e-300))


def _jitter_phase(aperture: Aperture, centre: Complex64, options: RobustOptions) -> Array:
    """2 pi df dt (M,), which undoes the turnaround jitter."""
    if not options.jitter or aperture.nic_us is None:
        return np.zeros(aperture.packets)
    ours_s = (aperture.nic_us[:, 0] - aperture.nic_us[0, 0]) * 1e-6
    turnaround_s = (aperture.nic_us[:, 1] - aperture.nic_us[:, 0]) * 1e-6
    offset_hz = carrier_offset_hz(centre, turnaround_s, ours_s, aperture.wavelength_m)
    late_s = jitter_s(turnaround_s, ours_s, offset_hz, aperture.wavelength_m)
    return np.asarray(2 * np.pi * offset_hz * late_s)


def counted_amplitude(amplitude: Array32, options: RobustOptions) -> Array32:
    """What packets of such amplitudes (M,) count with: the same, but for weak ones; or as received."""
    return np.minimum(amplitude / max(options.weak_below, 1e-12), np.float32(1.0)) if options.unit_power else amplitude


def _levelled(channel: Complex64, amplitude: Array32) -> Complex64:
    """Every packet's channel (M, S) with the signed amplitude (M,) it is to count with."""
    if channel.shape[1] == 1:
        return np.asarray(bounded_amplitude(channel) * amplitude[:, None], np.complex64)
    root = np.sqrt(2 * np.square(channel.view(np.float32)).mean(axis=1))
    return np.asarray(channel * (amplitude / np.maximum(root, np.float32(1e-12)))[:, None])
