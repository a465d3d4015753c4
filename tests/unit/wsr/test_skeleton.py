"""Skeletons of a path against the defining sum over all its packets, in complex128."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.refinement import refine_peak
from benchmarks.scenes import helix
from tests.unit.wsr.scene import WAVELENGTH_M, circle, weave
from wsr.geometry import direction, great_circle
from wsr.skeleton import condensed

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def _directions() -> Array:
    u = np.random.default_rng(0).normal(size=(3000, 3))
    return np.asarray(u / np.linalg.norm(u, axis=1, keepdims=True))


U = _directions()


def _paths() -> dict[str, Array]:
    rng = np.random.default_rng(1)
    standing = np.vstack([weave(400)[1], weave(400)[1][-1] + 1e-4 * rng.normal(size=(600, 3))])
    return {
        "helix": helix(2000).chi_m,
        "weave": weave(900)[1],
        "thrice round": np.tile(circle(500)[1], (3, 1)),
        "standing at its end": standing,
        "shaking by 0.1 mm": helix(3000).chi_m + 1e-4 * rng.normal(size=(3000, 3)),
        "straight": np.linspace(0.0, 1.5, 700)[:, None] * np.array([0.8, 0.5, 0.1]),
    }


PATHS = _paths()


def _channel(p_m: Array, kind: str) -> Complex:
    rng = np.random.default_rng(2)
    if kind == "noise":
        return np.asarray(np.exp(2j * np.pi * rng.uniform(size=len(p_m))))
    sources_m = np.array([[4.0, 3.0, -1.0], [-6.0, 5.0, 2.0], [2.0, -9.0, 0.5]])
    d_m = np.linalg.norm(p_m[:, None] - sources_m, axis=2)
    one_way = np.exp(-2j * np.pi / WAVELENGTH_M * d_m) @ np.array([1.0, 0.7, 0.6])
    return np.asarray(one_way**2)


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("kind", ["echoes", "noise"])
def test_the_field_is_the_same(name: str, kind: str) -> None:
    """To 1e-4 of the maximum of the power, as the whole profile has it."""
    x, g = PATHS[name] * (2.0 / WAVELENGTH_M), _channel(PATHS[name], kind)
    fewer, weights, _ = condensed(x, g[:, None])
    exact = np.abs(np.exp(-2j * np.pi * (U @ x.T)) @ g) ** 2
    power = np.abs(np.exp(-2j * np.pi * (U @ fewer.T)) @ weights[:, 0]) ** 2
    assert len(fewer) < 0.7 * len(x)
    assert np.abs(power - exact).max() < 1e-4 * exact.max()
    # Weights that were much larger than the packets' would lose what float32 has to give.
    assert np.abs(weights).sum() < 3.0 * np.abs(g).sum()


def test_a_smooth_path_needs_what_its_length_needs() -> None:
    """About three members to a half wavelength of path, however many packets there are."""
    sizes = [len(condensed(helix(m).chi_m * (2.0 / WAVELENGTH_M), helix(m).channel[:, None])[0]) for m in (400, 4000)]
    assert max(sizes) < 160
    assert abs(sizes[0] - sizes[1]) < 15


def test_the_peak_stays_within_a_hundredth_of_a_degree() -> None:
    p_m = PATHS["helix"]
    g = _channel(p_m, "echoes")
    fewer, weights, _ = condensed(p_m * (2.0 / WAVELENGTH_M), g[:, None])
    azimuth, polar = math.atan2(3.0, 4.0), math.radians(100.0)
    a = refine_peak(p_m, g, WAVELENGTH_M, azimuth_rad=azimuth, polar_rad=polar)
    b = refine_peak(fewer * (WAVELENGTH_M / 2.0), weights[:, 0], WAVELENGTH_M, azimuth_rad=azimuth, polar_rad=polar)
    assert great_circle(direction(a[0], a[1]), direction(b[0], b[1])) < math.radians(0.01)


def test_packets_without_a_path_stay_as_they_are() -> None:
    rng = np.random.default_rng(3)
    x = rng.uniform(-10.0, 10.0, size=(500, 3))
    g: Complex = np.exp(2j * np.pi * rng.uniform(size=(500, 2))).astype(np.complex128)
    fewer, weights, _ = condensed(x, g)
    assert np.array_equal(fewer, x)
    assert np.array_equal(weights, g)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_hardly_any_packets(count: int) -> None:
    x = np.zeros((count, 3))
    g: Complex = np.arange(1.0, count + 1)[:, None].astype(np.complex128)
    fewer, weights, _ = condensed(x, g)
    assert weights.sum() == pytest.approx(g.sum())
    assert len(fewer) == len(weights) <= count


def test_spherical_waves_of_several_columns_are_kept() -> None:
    """Of a source at 2 m, by the weights that plane waves gave."""
    p_m = PATHS["weave"] - PATHS["weave"].mean(axis=0)
    h: Complex = np.stack([_channel(p_m, "noise"), 0.5j * _channel(p_m, "echoes")], axis=1).astype(np.complex128)
    fewer, weights, _ = condensed(np.asarray(p_m / WAVELENGTH_M, np.float64), h)
    turns = [np.linalg.norm(2.0 * U[:, None] - places, axis=2) / WAVELENGTH_M for places in (p_m, fewer * WAVELENGTH_M)]
    exact, lean = (np.exp(2j * np.pi * t) @ w for t, w in zip(turns, (h, weights), strict=True))
    assert np.abs(exact - lean).max() < 5e-4 * np.abs(exact).max()
