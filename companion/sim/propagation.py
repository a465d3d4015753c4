"""Radio waves between antennas: the direct path, mirror images, and what finite things scatter, as a channel at each of
the card's subcarriers.

Constants and physics are written out here on purpose instead of being taken from the estimator's package: the
simulator is what the estimator's signs and scales are checked against. Every path is the same in both directions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from companion.sim.scenario import RadioScenario, Reflector, Scatterer

Array = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]

LIGHT_M_S: Final = 299_792_458.0
SUBCARRIER_INDICES: Final = np.array([*range(-28, -1, 2), -1, *range(1, 28, 2), 28], dtype=np.float64)
"""The 30 reported subcarriers of a 20 MHz channel."""
SUBCARRIER_STEP_HZ: Final = 312_500.0
_STEPS: Final = np.diff(SUBCARRIER_INDICES).astype(int).tolist()
_PARALLEL: Final = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Subcarriers at whole multiples (S,) of a spacing, rising."""

    index: npt.NDArray[np.int64]
    step_hz: float

    @property
    def hz(self) -> Array:
        """From the channel's centre."""
        return np.asarray(self.index * self.step_hz, np.float64)


def carrier_hz(channel: int) -> float:
    """Centre of a channel in the 5 GHz band: 5000 + 5 * channel MHz."""
    return 5e9 + 5e6 * channel


def propagate(tx_enu_m: Array, rx_enu_m: Array, radio: RadioScenario, lattice: Lattice | None = None) -> ComplexArray:
    """Channel gain (N, S, R) from tx_enu_m (N, 3) to rx_enu_m (N, R, 3), both isotropic, at the subcarriers of a 5300
    (S = 30) or of `lattice`.

    H(f) = sum over paths of a * lambda / (4 pi d) * exp(-j 2 pi f d / c) (Friis), with one path to the transmitter
    itself and one to each of its mirror images, and
    H(f) = lambda / (4 pi) * s / sqrt((d1^2 + s^2) (d2^2 + s^2)) * exp(-j 2 pi f (d1 + d2) / c), s^2 = sigma / (4 pi),
    over each scatterer of cross section sigma, d1 and d2 away: the radar equation, which near by would send out more
    than arrives, bounded so that it never does.
    """
    centre_hz = carrier_hz(radio.channel)
    friis_m = LIGHT_M_S / (4 * math.pi * centre_hz)
    gains, sources_m = _images(tx_enu_m, radio)
    d_m = _apart_m(sources_m[:, :, None, :], rx_enu_m)
    amplitude = friis_m * gains[:, None, None] / d_m
    if radio.scatterers:
        scattered_m, share_per_m = _scattered(tx_enu_m, rx_enu_m, radio.scatterers)
        d_m, amplitude = np.concatenate([d_m, scattered_m]), np.concatenate([amplitude, friis_m * share_per_m])
    if lattice is not None:
        return _over_lattice(amplitude, d_m, centre_hz, lattice)
    return _over_subcarriers(amplitude, d_m, centre_hz)


def _over_lattice(amplitude: ComplexArray, d_m: Array, centre_hz: float, lattice: Lattice) -> ComplexArray:
    """(N, S, R): the sum over paths (P, N, R). With k = first + rows a + b every wave is a product of one factor for a
    and one for b, so that the sum over paths is a product of two matrices."""
    first, count = int(lattice.index[0]), int(lattice.index[-1] - lattice.index[0]) + 1
    rows = math.isqrt(count) + 1
    turn = (-2j * math.pi * lattice.step_hz / LIGHT_M_S) * np.moveaxis(d_m, 0, -1)[..., None]
    start = amplitude * np.exp((-2j * math.pi * centre_hz / LIGHT_M_S) * d_m)
    coarse = np.moveaxis(start, 0, -1)[..., None] * np.exp(turn * (first + rows * np.arange(-(-count // rows))))
    fine = np.exp(turn * np.arange(rows))
    waves = np.swapaxes(coarse, -1, -2) @ fine
    whole = waves.reshape(*waves.shape[:2], -1)
    return np.ascontiguousarray(np.swapaxes(whole[..., lattice.index - first], 1, 2))


def _over_subcarriers(amplitude: ComplexArray, d_m: Array, centre_hz: float) -> ComplexArray:
    """(N, 30, R): the sum over paths (P, N, R). From one subcarrier to the next a wave turns by a fixed angle."""
    turn = (-2j * math.pi * SUBCARRIER_STEP_HZ / LIGHT_M_S) * d_m
    once = np.exp(turn)
    turns = {1: once, 2: once * once}
    first = (-2j * math.pi * centre_hz / LIGHT_M_S) * d_m + SUBCARRIER_INDICES[0] * turn
    wave = amplitude * np.exp(first)
    result = np.empty((d_m.shape[1], SUBCARRIER_INDICES.size, d_m.shape[2]), np.complex128)
    for number, step in enumerate([0, *_STEPS]):
        if step:
            wave *= turns[step]
        wave.sum(axis=0, out=result[:, number])
    return result


def _images(tx_enu_m: Array, radio: RadioScenario) -> tuple[ComplexArray, Array]:
    """Gains (P,) and places (P, N, 3) of the transmitter and its mirror images."""
    gains: list[complex] = [radio.direct_gain]
    sources_m = [tx_enu_m]
    for planes in _orders(radio):
        gain, image_m = 1.0 + 0.0j, tx_enu_m
        for plane in planes:
            normal = np.array(plane.normal)
            image_m = image_m - 2 * (image_m @ normal - plane.offset_m)[:, None] * normal
            gain *= plane.gain * np.exp(1j * plane.phase_rad)
        gains.append(gain)
        sources_m.append(image_m)
    return np.array(gains), np.stack(sources_m)


def _orders(radio: RadioScenario) -> Iterator[tuple[Reflector, ...]]:
    """The reflectors that turn each wave, in the order in which it meets them. The planes are the sides of a room with
    right angles: then two that meet make one image, whichever comes first, and two that face each other make two."""
    planes = radio.reflectors
    yield from ((plane,) for plane in planes)
    if radio.reflection_order < 2:
        return
    for index, plane in enumerate(planes):
        for other in planes[index + 1 :]:
            yield plane, other
            if abs(float(np.dot(plane.normal, other.normal))) > _PARALLEL:
                yield other, plane


def _scattered(tx_enu_m: Array, rx_enu_m: Array, scatterers: Sequence[Scatterer]) -> tuple[Array, ComplexArray]:
    """Lengths and amplitudes without lambda / (4 pi) [1/m], (S, N, R) each."""
    places_m = np.array([scatterer.p_enu_m for scatterer in scatterers])
    size_m = np.sqrt(np.array([scatterer.cross_section_m2 for scatterer in scatterers]) / (4 * math.pi))[:, None, None]
    phase = np.exp(1j * np.array([scatterer.phase_rad for scatterer in scatterers]))[:, None, None]
    from_tx_m = _apart_m(places_m[:, None, :], tx_enu_m)[:, :, None]
    to_rx_m = _apart_m(places_m[:, None, None, :], rx_enu_m)
    size2 = size_m * size_m
    share_per_m = phase * size_m / np.sqrt((from_tx_m**2 + size2) * (to_rx_m**2 + size2))
    return from_tx_m + to_rx_m, share_per_m


def _apart_m(a_m: Array, b_m: Array) -> Array:
    """Distances (...) of points (..., 3)."""
    apart_m = a_m - b_m
    return np.asarray(np.sqrt(np.einsum("...x,...x->...", apart_m, apart_m)))
