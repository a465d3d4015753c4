"""Closed forms of the information of three paths, as means over the aperture for a phase variance of 1 rad^2.

With k = 2 pi / lambda (one-way; 4 pi / lambda for the product), theta the polar angle and phi the azimuth of the
source, in the paper's letters J = [[A, C], [C, B]] of (theta, phi):

    helix   r (sin t cos t, sin^2 t, cos t), t in [0, 2 pi)
            A = k^2 r^2 / 4 (2 sin^2 theta + cos^2 theta (1 - cos 2 phi / 2)),
            B = k^2 r^2 / 8 sin^2 theta (2 + cos 2 phi),
            C = k^2 r^2 / 4 sin theta cos theta sin phi cos phi
    circle  r (cos t, sin t, 0)
            A = k^2 r^2 / 2 cos^2 theta,  B = k^2 r^2 / 2 sin^2 theta,  C = 0
    line    s e, s in [0, L)
            (A, B, C) = k^2 L^2 / 3 (a^2, b^2, a b),  a = du/dtheta . e,  b = du/dphi . e

with the phase at the origin known. If it is unknown the square of the centroid's own share goes off: the helix has its
centroid at (0, r / 2, 0), the circle at 0, and the line keeps L^2 / 12 of L^2 / 3. Multiply by the number of packets.
The paper prints other factors: docs/maths.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wsr.crb.bound import Phase

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MeanInformation:
    """Information of (theta, phi) per packet: A, B and C, in rad^-2, of the shape of the directions."""

    a: Array
    b: Array
    c: Array


def helix(
    radius_m: float,
    wavelength_m: float,
    azimuth_rad: ArrayLike,
    polar_rad: ArrayLike,
    *,
    phase: Phase = "known",
    round_trip: bool = False,
) -> MeanInformation:
    """The spherical helix with polar angle and azimuth both t, at equal steps of t."""
    phi, theta = np.asarray(azimuth_rad, float), np.asarray(polar_rad, float)
    unit = (_wavenumber(wavelength_m, round_trip) * radius_m) ** 2 / 4
    a = unit * (2 * np.sin(theta) ** 2 + np.cos(theta) ** 2 * (1 - np.cos(2 * phi) / 2))
    b = unit / 2 * np.sin(theta) ** 2 * (2 + np.cos(2 * phi))
    c = unit * np.sin(theta) * np.cos(theta) * np.sin(phi) * np.cos(phi)
    if phase == "unknown":
        by_theta, by_phi = np.cos(theta) * np.sin(phi), np.sin(theta) * np.cos(phi)
        a, b, c = a - unit * by_theta**2, b - unit * by_phi**2, c - unit * by_theta * by_phi
    return MeanInformation(np.asarray(a), np.asarray(b), np.asarray(c))


def circle(
    radius_m: float, wavelength_m: float, azimuth_rad: ArrayLike, polar_rad: ArrayLike, round_trip: bool = False
) -> MeanInformation:
    """A horizontal circle about the origin, which is its centroid: the phase may be known or not."""
    phi, theta = np.broadcast_arrays(np.asarray(azimuth_rad, float), np.asarray(polar_rad, float))
    unit = (_wavenumber(wavelength_m, round_trip) * radius_m) ** 2 / 2
    return MeanInformation(unit * np.cos(theta) ** 2, unit * np.sin(theta) ** 2, np.zeros_like(phi))


def line(
    length_m: float,
    along: ArrayLike,
    wavelength_m: float,
    *,
    azimuth_rad: ArrayLike,
    polar_rad: ArrayLike,
    phase: Phase = "known",
    round_trip: bool = False,
) -> MeanInformation:
    """A straight line of `length_m` from the origin along the unit vector `along` (3,). A B = C²."""
    phi, theta = np.asarray(azimuth_rad, float), np.asarray(polar_rad, float)
    x, y, z = np.asarray(along, float)
    unit = (_wavenumber(wavelength_m, round_trip) * length_m) ** 2 / (3 if phase == "known" else 12)
    by_theta = np.cos(theta) * (np.cos(phi) * x + np.sin(phi) * y) - np.sin(theta) * z
    by_phi = np.sin(theta) * (np.cos(phi) * y - np.sin(phi) * x)
    return MeanInformation(
        np.asarray(unit * by_theta**2), np.asarray(unit * by_phi**2), np.asarray(unit * by_theta * by_phi)
    )


def _wavenumber(wavelength_m: float, round_trip: bool) -> float:
    return (4.0 if round_trip else 2.0) * np.pi / wavelength_m
