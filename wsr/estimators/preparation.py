"""From packets to bins of the path: jitter, one-way channel, signs, gates, bins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from wsr.aperture import MIN_PACKETS, Aperture
from wsr.channel import bounded_amplitude
from wsr.errors import ApertureError
from wsr.estimators.options import RobustOptions
from wsr.path_bins import Bins, path_bins
from wsr.reciprocity import ChainLimits, chain, fold, without_delay
from wsr.turnaround import carrier_offset_hz, jitter_s

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Channel = TypeVar("Channel", NDArray[np.complex64], NDArray[np.complex128])


@dataclass(frozen=True, slots=True, eq=False)
class Prepared:
    """Bins of the path with their channels, the wavelength of their phase, and what was left out."""

    bins: Bins
    wavelength_m: float
    dropped: dict[str, int]
    reciprocity: float
    offset_hz: float
    bin_t_s: Array
    """(B,) mean time of each bin."""


def prepare(aperture: Aperture, options: RobustOptions) -> Prepared:
    """From packets to bins: jitter, one-way channel, signs, gates, bins. Raises ApertureError if too little is left."""
    channel, agreement, centre = _folded(aperture)
    rotation, offset_hz = _rotation(aperture, centre, options)
    clock_s = aperture.t_s if aperture.nic_us is None else (aperture.nic_us[:, 0] - aperture.nic_us[0, 0]) * 1e-6
    keep = np.ones(aperture.packets, np.bool_)
    segment = np.zeros(aperture.packets, np.int64)
    if options.reciprocity:
        keep &= agreement > options.min_reciprocity
    disagree = int(np.count_nonzero(~keep))
    wavelength_m = aperture.wavelength_m
    if options.one_way:
        channel = without_delay(channel * np.exp(0.5j * np.angle(rotation))[:, None])
        used = np.flatnonzero(keep)
        limits = ChainLimits(
            far_m=options.far_wavelengths * wavelength_m,
            near_m=options.near_wavelengths * wavelength_m,
            gate=options.gate,
        )
        sign, fits, number = chain(channel[used], clock_s[used], aperture.chi_m[used], limits)
        channel[used] *= sign[:, None]
        keep[used] = fits
        segment[used] = number
    else:
        channel = without_delay(_product(aperture)) * rotation[:, None]
        wavelength_m = wavelength_m / 2
    if not options.wideband:
        channel = channel.mean(axis=1, keepdims=True)
    channel = _levelled(channel, packet_amplitude(aperture), options)
    if np.count_nonzero(keep) < MIN_PACKETS:
        kept = f"{np.count_nonzero(keep)} of {aperture.packets} packets are consistent"
        raise ApertureError(f"only {kept}; needs at least {MIN_PACKETS}")
    length_m = options.bin_wavelengths * aperture.wavelength_m if options.path_bins else None
    bins = path_bins(aperture.chi_m, channel, keep, segment, length_m)
    unfit = aperture.packets - int(np.count_nonzero(keep)) - disagree
    dropped = {"ends disagree": disagree, "phase step": unfit}
    return Prepared(
        bins,
        wavelength_m,
        {reason: count for reason, count in dropped.items() if count},
        float(np.median(agreement)),
        offset_hz,
        bins.means(aperture.t_s),
    )


def _folded(aperture: Aperture) -> tuple[Complex, Array, Complex]:
    """As `fold`; without both directions the root of the product, which is then all there is."""
    if aperture.forward is not None and aperture.reverse is not None:
        return fold(_unit_mean(aperture.forward), _unit_mean(aperture.reverse))
    centre = _unit_mean(aperture.channel)
    return np.sqrt(centre)[:, None], np.ones(aperture.packets), centre


def _unit_mean(channel: Channel) -> Channel:
    """In units of its own mean amplitude: receivers differ in theirs."""
    return cast(Channel, channel / np.abs(channel).mean(dtype=np.float64).astype(channel.real.dtype))


def _product(aperture: Aperture) -> Complex:
    if aperture.forward is not None and aperture.reverse is not None:
        return np.asarray(_unit_mean(aperture.forward).astype(np.complex128) * _unit_mean(aperture.reverse))
    return _unit_mean(aperture.channel)[:, None]


def _rotation(aperture: Aperture, centre: Complex, options: RobustOptions) -> tuple[Complex, float]:
    """exp(j 2 pi df dt) (M,), which undoes the turnaround jitter, and df."""
    if not options.jitter or aperture.nic_us is None:
        return np.ones(aperture.packets, np.complex128), 0.0
    ours_s = (aperture.nic_us[:, 0] - aperture.nic_us[0, 0]) * 1e-6
    turnaround_s = (aperture.nic_us[:, 1] - aperture.nic_us[:, 0]) * 1e-6
    offset_hz = carrier_offset_hz(centre, turnaround_s, ours_s, aperture.wavelength_m)
    late_s = jitter_s(turnaround_s, ours_s, offset_hz, aperture.wavelength_m)
    return np.exp(2j * np.pi * offset_hz * late_s), offset_hz


def packet_amplitude(aperture: Aperture) -> Array:
    """Amplitude (M,) of the one-way channel over that of the median packet."""
    if aperture.forward is not None and aperture.reverse is not None:
        power = [(np.abs(_unit_mean(ends)) ** 2).mean(axis=1) for ends in (aperture.forward, aperture.reverse)]
        amplitude = (power[0] * power[1]) ** 0.25
    else:
        amplitude = np.sqrt(np.abs(_unit_mean(aperture.channel)))
    return np.asarray(amplitude / max(float(np.median(amplitude)), 1e-12), np.float64)


def counted_amplitude(amplitude: Array, options: RobustOptions) -> Array:
    """What packets of such amplitudes (M,) count with: the same, but for weak ones; or as received."""
    return np.minimum(amplitude / max(options.weak_below, 1e-12), 1.0) if options.unit_power else amplitude


def _levelled(channel: Complex, amplitude: Array, options: RobustOptions) -> Complex:
    """Every packet's channel (M, S) with the amplitude it is to count with."""
    if channel.shape[1] == 1:
        level = bounded_amplitude(channel)
    else:
        level = channel / np.maximum(np.sqrt((np.abs(channel) ** 2).mean(axis=1, keepdims=True)), 1e-12)
    return np.asarray(level * counted_amplitude(amplitude, options)[:, None])
