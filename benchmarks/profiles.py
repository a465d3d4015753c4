"""Far-field profiles by the defining sum, with float32 GEMM, by our direct kernel and by skeletons; and the sliding
window."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.oracle import bartlett_profile_oracle
from benchmarks.scenes import WAVELENGTH_M, helix
from benchmarks.sliding import SlidingProfile
from benchmarks.timing import best_s
from wsr.directions import AZIMUTH_RAD, POLAR_RAD
from wsr.geometry import direction
from wsr.kernel import bartlett_power
from wsr.profile import bartlett_profile
from wsr.skeleton import condensed

BATCH = 32
_FLOPS = 22  # a packet and four mirrored directions: a complex product, eight sums of products
_SQUARE = 768
_ATOM = "goldmont"  # the class of processor on an UP Squared: SSE4.2, no AVX


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileRow:
    """Seconds for one 360 x 180 profile of `packets` packets."""

    packets: int
    naive_s: float
    gemm_s: float
    direct_s: float
    """Our kernel over all packets."""
    ours_s: float
    members: int
    """Of the path's skeletons."""
    bound_s: float
    """What the arithmetic for the members alone would take at the rate of a large matrix product in float32."""
    batch_s: float
    """Adding a batch of 32 packets to a sliding window."""
    batch_read_s: float
    """Adding it and reading the window's profile."""


def profile_rows(counts: tuple[int, ...]) -> list[ProfileRow]:
    rows = []
    flop_s = _seconds_a_flop()
    for packets in counts:
        aperture = helix(packets)
        chi, g = aperture.chi_m, aperture.channel
        window = SlidingProfile(WAVELENGTH_M)
        window.add(chi, g)
        x, unit = chi * (2.0 / WAVELENGTH_M), g / np.abs(g).sum()
        members = len(condensed(x, unit[:, None])[0])
        rows.append(
            ProfileRow(
                packets=packets,
                naive_s=best_s(lambda chi=chi, g=g: bartlett_profile_oracle(chi, g, WAVELENGTH_M), repeats=1),  # type: ignore[misc]
                gemm_s=best_s(lambda chi=chi, g=g: _gemm_profile(chi, g), repeats=2),  # type: ignore[misc]
                direct_s=best_s(lambda x=x, unit=unit: bartlett_power(x, unit)),  # type: ignore[misc]
                ours_s=best_s(lambda chi=chi, g=g: bartlett_profile(chi, g, WAVELENGTH_M), repeats=40),  # type: ignore[misc]
                members=members,
                bound_s=members * POLAR_RAD.size * AZIMUTH_RAD.size / 4 * _FLOPS * flop_s,
                batch_s=best_s(_slide(window, chi, g)),
                batch_read_s=best_s(_slide(window, chi, g, read=True)),
            )
        )
    return rows


def _seconds_a_flop() -> float:
    square = np.ones((_SQUARE, _SQUARE), np.float32)
    return best_s(lambda: square @ square, repeats=20) / (2 * _SQUARE**3)


def atom_profile_s(packets: int) -> float:
    """Ours, compiled for an Atom in a process of its own [s]."""
    code = (
        "from benchmarks.scenes import WAVELENGTH_M, helix\n"
        "from benchmarks.timing import best_s\n"
        "from wsr.profile import bartlett_profile\n"
        f"a = helix({packets})\n"
        "print(best_s(lambda: bartlett_profile(a.chi_m, a.channel, WAVELENGTH_M), repeats=20))"
    )
    environment = os.environ | {"NUMBA_CPU_NAME": _ATOM, "NUMBA_CPU_FEATURES": ""}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def grid_times_s(packets: int, sizes: tuple[int, ...]) -> dict[int, float]:
    """Ours on grids of so many rows, and twice as many columns [s]."""
    aperture = helix(packets)
    chi = aperture.chi_m * (2.0 / WAVELENGTH_M)
    return {size: best_s(lambda size=size: bartlett_power(chi, aperture.channel, size)) for size in sizes}  # type: ignore[misc]


def _slide(
    window: SlidingProfile, chi: npt.NDArray[np.float64], g: npt.NDArray[np.complex128], read: bool = False
) -> Callable[[], object]:
    def work() -> object:
        window.add(chi[:BATCH], g[:BATCH])
        return window.profile() if read else None

    return work


def _gemm_profile(chi_m: npt.NDArray[np.float64], channel: npt.NDArray[np.complex128]) -> npt.NDArray[np.float32]:
    """What a careful NumPy user writes: float32 sines and cosines, and real matrix products."""
    k_chi = (chi_m * (4 * np.pi / WAVELENGTH_M)).astype(np.float32)
    parts = np.stack([channel.real, channel.imag], axis=1).astype(np.float32)
    power = np.empty((POLAR_RAD.size, AZIMUTH_RAD.size), np.float32)
    for row, polar in enumerate(POLAR_RAD):
        phase = direction(AZIMUTH_RAD, polar).astype(np.float32) @ k_chi.T
        cosine, sine = np.cos(phase) @ parts, np.sin(phase) @ parts
        power[row] = (cosine[:, 0] + sine[:, 1]) ** 2 + (cosine[:, 1] - sine[:, 0]) ** 2
    return power / np.float32(np.abs(channel).sum() ** 2)
