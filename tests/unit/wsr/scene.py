"""Paths and channels for tests of `wsr`, from distances alone: no steering vector, no direction, no shared sign."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture, make_aperture
from wsr.geometry import direction, great_circle
from wsr.ofdm import GRID_5300

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
CsiRows = NDArray[np.complex64]

WAVELENGTH_M = 299_792_458.0 / 5.540e9
DIRECTIONS = [d for d in itertools.product((-1, 0, 1), (-1, 0, 1), (-1, 0, 1)) if any(d)]


def weave(packets: int = 600) -> tuple[Array, Array]:
    """Times (M,) and positions (M, 3) of a climbing loop, 0.8 m wide and 0.4 m high, away from the origin."""
    t = np.linspace(0.0, 3.0, packets)
    x = 0.4 * np.cos(2.0 * t) + 5.0
    y = 0.35 * np.sin(2.3 * t) - 2.0
    z = 0.15 * np.sin(3.1 * t + 0.4) + 0.05 * t + 1.0
    return t, np.stack([x, y, z], axis=-1)


def circle(packets: int = 600, radius_m: float = 0.3) -> tuple[Array, Array]:
    """Times (M,) and positions (M, 3) once around a horizontal circle."""
    t = np.linspace(0.0, 3.0, packets, endpoint=False)
    turn = 2 * np.pi * t / 3.0
    return t, radius_m * np.stack([np.cos(turn), np.sin(turn), np.zeros(packets)], axis=-1)


def one_way(p_i: Array, p_j: Array, offset_rad: Array | float = 0.0) -> Complex:
    """Channel h = exp(-j 2 pi d / lambda) / d over the distance d of two antennas, with an oscillator's offset."""
    distance = np.linalg.norm(p_i - p_j, axis=-1)
    return np.asarray(np.exp(-2j * np.pi * distance / WAVELENGTH_M + 1j * offset_rad) / distance)


def round_trip(p_i: Array, p_j: Array, noise_rad: float = 0.0, seed: int = 0) -> Complex:
    """Forward times reverse channel (M,); the offsets of the two carriers are random and opposite."""
    rng = np.random.default_rng(seed)
    packets = np.broadcast_shapes(p_i.shape, p_j.shape)[0]
    offset = rng.uniform(-np.pi, np.pi, packets)
    forward, reverse = one_way(p_i, p_j, offset), one_way(p_i, p_j, -offset)
    return np.asarray(forward * reverse * np.exp(1j * noise_rad * rng.normal(size=packets)))


def exchange(
    p_i: Array,
    p_j: Array,
    noise: float = 0.05,
    seed: int = 0,
    echo: tuple[Array, float] | None = None,
    offset_hz: float = 0.0,
    t_s: Array | None = None,
    turnaround_s: Array | None = None,
    subcarrier_hz: Array | None = None,
) -> tuple[CsiRows, CsiRows]:
    """Forward and reverse channels (M, S) of an exchange, the second measured `turnaround_s` (M,) after the first.

    Each packet has a random phase and delay of its own at either end, opposite for the two; complex noise of deviation
    `noise` per subcarrier, of the direct path's amplitude. `echo` is the place of an image source and its amplitude.
    """
    rng = np.random.default_rng(seed)
    subcarrier_hz = GRID_5300.hz if subcarrier_hz is None else subcarrier_hz
    frequency = 299_792_458.0 / WAVELENGTH_M + subcarrier_hz
    h = np.zeros((p_i.shape[0], subcarrier_hz.size), np.complex128)
    for place, amplitude in [(p_j, 1.0), *([] if echo is None else [echo])]:
        distance = np.linalg.norm(p_i - place, axis=-1)
        h += amplitude * np.exp(-2j * np.pi * np.outer(distance, frequency) / 299_792_458.0)
    packets = len(h)
    clock = np.zeros(packets) if t_s is None else t_s
    late = np.zeros(packets) if turnaround_s is None else turnaround_s
    phase = rng.uniform(-np.pi, np.pi, packets)[:, None]
    delay = rng.uniform(0.0, 1e-7, packets)[:, None] * (2 * np.pi * subcarrier_hz)
    turn = np.exp(1j * (phase - delay + 2 * np.pi * offset_hz * clock[:, None]))
    back = np.exp(-1j * (phase - delay + 2 * np.pi * offset_hz * (clock + late)[:, None]))
    grain = noise * (rng.normal(size=(2, 2, packets, subcarrier_hz.size)) * np.sqrt(0.5))
    forward = turn * (h + grain[0, 0] + 1j * grain[0, 1])
    reverse = back * (h + grain[1, 0] + 1j * grain[1, 1])
    return forward.astype(np.complex64), reverse.astype(np.complex64)


def far(p: Array, u: Array, distance_m: float = 20_000.0) -> Array:
    """Position (1, 3) of a transmitter so far off the mean of p (M, 3) along u that its waves are flat."""
    return np.asarray((p.mean(axis=0) + distance_m * u)[None, :])


def aperture_towards(t: Array, p: Array, source: Array, **scene: float) -> Aperture:
    """What an `exchange` with a source at (1, 3) gives along the path."""
    forward, reverse = exchange(p, source, **scene)  # type: ignore[arg-type]
    product = (forward * reverse).mean(axis=1)
    return make_aperture(t, p, product, WAVELENGTH_M, forward=forward, reverse=reverse)


def error_deg(estimate: AoaEstimate, source: Array) -> float:
    """Great circle from the estimate to the source at (1, 3), seen from the estimate's reference point."""
    to = source[0] - np.array(estimate.reference_p_m)
    u = to / np.linalg.norm(to)
    return math.degrees(great_circle(direction(estimate.azimuth_rad, estimate.polar_rad), u))
