"""From CSI to one complex value per packet, and from two one-way series to round-trip pairs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsr.ofdm import GRID_5300, Grid, known

SPEED_OF_LIGHT_M_S = 299_792_458.0
CHANNELS_5GHZ = frozenset((*range(36, 65, 4), *range(100, 145, 4), *range(149, 178, 4)))
"""Numbers of the 20 MHz channels at 5 GHz."""
_CENTRES_WIDE = frozenset(
    (*range(38, 63, 8), *range(102, 143, 8), *range(151, 176, 8), 42, 58, 106, 122, 138, 155, 171, 50, 114, 163)
)
"""Numbers that name the middle of 40, 80 or 160 MHz."""

WIDTHS_MHZ = (20, 40, 80, 160)
_COUNTER_MODULUS = 2**32
_SLOPE_STEPS = 3

Complex = NDArray[np.complex128]
Indices = NDArray[np.intp]


def channel_frequency_hz(channel: int) -> float:
    """Centre frequency of a channel of `CHANNELS_5GHZ`, 5000 + 5 n MHz. Raises ValueError for any other number, which
    says what it is: the one place that knows which channels there are."""
    if channel in CHANNELS_5GHZ:
        return (5000.0 + 5.0 * channel) * 1e6
    if 1 <= channel <= 14:
        # Its reports there have a phase known but for quarter turns, and the exchange's product keeps them.
        what = "is a 2.4 GHz channel, where the card's phase is ambiguous by quarter turns"
    elif channel in _CENTRES_WIDE:
        what = "is the centre of a wide channel; the card listens on one of 20 MHz beside it"
    else:
        what = "is no 5 GHz channel"
    raise ValueError(f"channel {channel} {what}; expected one of 36, 40 .. 64, 100, 104 .. 144, 149, 153 .. 177")


def wavelength_m(channel: int) -> float:
    """Wavelength at the centre of a 5 GHz channel, in metres. Raises ValueError as `channel_frequency_hz`."""
    return SPEED_OF_LIGHT_M_S / channel_frequency_hz(channel)


def wide_channel(channel: int, width_mhz: int) -> int:
    """The number of the centre of the 20, 40, 80 or 160 MHz that a channel of `CHANNELS_5GHZ` is part of. Raises
    ValueError for a channel that is none, or part of no such band."""
    channel_frequency_hz(channel)
    first = 149 if channel >= 149 else 100 if channel >= 100 else 36
    count = width_mhz // 20
    block = (channel - first) // 4 // count
    low = first + 4 * count * block
    if low + 4 * (count - 1) not in CHANNELS_5GHZ:
        raise ValueError(f"channel {channel} is part of no band of {width_mhz} MHz")
    return low + 2 * (count - 1)


def width_mhz(grid: Grid) -> int:
    """Of the band that subcarriers on `grid` fill."""
    return next((width for width in WIDTHS_MHZ if grid.bandwidth_hz <= width * 1e6), WIDTHS_MHZ[-1])


def band_wavelength_m(channel: int, grid: Grid | None) -> float:
    """Wavelength at the centre of the band of `grid` around a 20 MHz channel, of which it is part; without a grid, or
    over 20 MHz, that of the channel. Raises ValueError as `wide_channel`."""
    if grid is None or width_mhz(grid) == WIDTHS_MHZ[0]:
        return wavelength_m(channel)
    return SPEED_OF_LIGHT_M_S / ((5000.0 + 5.0 * wide_channel(channel, width_mhz(grid))) * 1e6)


def centre_channel(csi: ArrayLike, grid: Grid | None = None) -> Complex:
    """Channel at the true centre frequency (k = 0) from CSI (..., S) on `grid`, if None the 5300's; shape (...),
    complex128.

    The sampling offset of each packet is a delay, so a phase s k over the frequency k, which must not reach the
    result. s comes first from products of subcarriers 625 kHz apart (no unwrapping, good to +-0.8 us), then from a few
    least-squares steps on what phase is left, weighted by power. The mean of the turned-back subcarriers is the value
    at k = 0. Weak subcarriers count little, and a packet that is all zero gives zero.
    """
    values = np.asarray(csi, np.complex128)
    size = (GRID_5300 if grid is None else grid).size
    if values.shape[-1:] != (size,):
        raise ValueError(f"CSI has shape {values.shape}; the last axis must be {size} subcarriers")
    on = known(size, grid)
    k = on.k
    lagged = np.sum(values[..., on.second] * values[..., on.first].conj(), axis=-1)
    slope = np.angle(lagged) / on.lag
    for _ in range(_SLOPE_STEPS):
        slope = slope + _remaining_slope(values * np.exp(-1j * slope[..., None] * k), k)
    return np.asarray((values * np.exp(-1j * slope[..., None] * k)).mean(axis=-1))


def pair_by_counter(forward: ArrayLike, reverse: ArrayLike) -> tuple[Indices, Indices]:
    """Indices i, j (K,) with forward[i] == reverse[j], in the order of the forward series.

    Counters are compared modulo 2**32. A counter that either series holds more than once is left out: which of the
    packets answered which is unknown, and the product of two that do not belong together has a random phase.
    """
    ours, theirs = _as_counters(forward), _as_counters(reverse)
    our_values, our_first, our_count = np.unique(ours, return_index=True, return_counts=True)
    their_values, their_first, their_count = np.unique(theirs, return_index=True, return_counts=True)
    _, a, b = np.intersect1d(
        our_values[our_count == 1], their_values[their_count == 1], assume_unique=True, return_indices=True
    )
    i, j = our_first[our_count == 1][a], their_first[their_count == 1][b]
    order = np.argsort(i)
    return np.asarray(i[order], np.intp), np.asarray(j[order], np.intp)


def pair_by_time(
    forward_s: ArrayLike, reverse_s: ArrayLike, min_lag_s: float, max_lag_s: float
) -> tuple[Indices, Indices]:
    """Indices i, j (K,) with min_lag <= reverse_s[j] - forward_s[i] <= max_lag, both times in seconds of one clock.

    Each forward packet takes the earliest reverse packet in its range; a reverse packet that two of them want goes to
    the later one, which it is closer to. Both series may be unsorted. The order is that of forward time.
    """
    ahead, back = np.asarray(forward_s, float), np.asarray(reverse_s, float)
    i_sorted, j_sorted = np.argsort(ahead, kind="stable"), np.argsort(back, kind="stable")
    candidate = np.searchsorted(back[j_sorted], ahead[i_sorted] + min_lag_s, side="left")
    inside = candidate < back.size
    i_sorted, candidate = i_sorted[inside], candidate[inside]
    j = j_sorted[candidate]
    close = back[j] - ahead[i_sorted] <= max_lag_s
    i, j, candidate = i_sorted[close], j[close], candidate[close]
    last = np.append(candidate[1:] != candidate[:-1], True) if candidate.size else np.zeros(0, np.bool_)
    return np.asarray(i[last], np.intp), np.asarray(j[last], np.intp)


def strongest_antenna(csi: ArrayLike) -> int:
    """Index of the receive antenna with the highest mean power in CSI (N, S, R)."""
    values = np.asarray(csi)
    if values.ndim != 3 or values.size == 0:
        raise ValueError(f"CSI has shape {values.shape}; expected (packets, subcarriers, antennas), none of them 0")
    power = np.mean(np.square(np.abs(values)), axis=(0, 1))
    return int(np.argmax(power))


def bounded_amplitude(channel: ArrayLike) -> Complex:
    """The same phases with amplitudes divided by their median and cut at 1; shape kept, complex128.

    A faded packet has a noisy phase and should count less; a strong one is no better than most, since there the pose
    and the oscillator limit the phase, and its amplitude is as often a gain step of the receiver. Uncut, a few packets
    of a burst would be the aperture.
    """
    values = np.asarray(channel, np.complex128)
    amplitude = np.abs(values)
    median = float(np.median(amplitude)) if values.size else 0.0
    if median == 0.0:
        return values.copy()
    return np.asarray(values / np.maximum(amplitude, median))


def _remaining_slope(turned: Complex, k: NDArray[np.float64]) -> NDArray[np.float64]:
    """Least-squares slope (...) in rad per index of the phases (..., S) about their mean, weighted by power."""
    power = np.square(np.abs(turned))
    total = np.maximum(power.sum(axis=-1, keepdims=True), np.finfo(np.float64).tiny)
    phase = np.angle(turned * turned.sum(axis=-1, keepdims=True).conj())
    centred_k = k - (power * k).sum(axis=-1, keepdims=True) / total
    spread = np.maximum((power * centred_k**2).sum(axis=-1), np.finfo(np.float64).tiny)
    return np.asarray((power * centred_k * phase).sum(axis=-1) / spread)


def _as_counters(values: ArrayLike) -> NDArray[np.int64]:
    return np.mod(np.asarray(values).astype(np.int64), _COUNTER_MODULUS)
