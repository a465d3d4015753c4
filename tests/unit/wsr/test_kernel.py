"""The fast kernel against the defining sum: values, symmetry, speed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.oracle import bartlett_profile_oracle
from tests.unit.wsr.scene import WAVELENGTH_M, far, round_trip, weave
from wsr import kernel
from wsr.directions import AZIMUTH_RAD, ROWS, grid
from wsr.errors import ApertureError
from wsr.geometry import direction
from wsr.profile import bartlett_profile


@pytest.mark.parametrize("packets", [1, 7, 130, 530])
def test_agrees_with_the_oracle(packets: int) -> None:
    """Packet counts below, at no multiple of, and above the vector width and the block."""
    rng = np.random.default_rng(packets)
    chi = rng.normal(scale=0.4, size=(packets, 3))
    phase = 4 * np.pi / WAVELENGTH_M * chi @ direction(-2.0, 2.0) + 0.7 * rng.normal(size=packets)
    g = (rng.exponential(size=packets) * np.exp(1j * phase)).astype(np.complex128)
    fast, exact = bartlett_profile(chi, g, WAVELENGTH_M), bartlett_profile_oracle(chi, g, WAVELENGTH_M)
    # Rounding of single packets averages out; alone it reaches the coarser figure.
    limit = 1e-6 if packets > 100 else 3e-6
    assert np.abs(fast.power - exact.power).max() < limit * exact.power.max()


def test_long_aperture_loses_no_precision() -> None:
    """At 40 m the phases are thousands of turns; float32 phases would leave errors of 1e-4."""
    rng = np.random.default_rng(5)
    chi = rng.uniform(-20, 20, size=(64, 3))
    g = np.exp(4j * np.pi / WAVELENGTH_M * chi @ direction(0.5, 1.0))
    fast, exact = bartlett_profile(chi, g, WAVELENGTH_M), bartlett_profile_oracle(chi, g, WAVELENGTH_M)
    assert np.abs(fast.power - exact.power).max() < 3e-6


def test_perfect_coherence_is_one_whatever_the_amplitude() -> None:
    chi = np.zeros((30, 3))
    np.testing.assert_allclose(bartlett_profile(chi, np.full(30, 3e5 + 0j), 0.05).power, 1.0, atol=3e-6)
    np.testing.assert_allclose(bartlett_profile(chi, np.full(30, 1e-9j), 0.05).power, 1.0, atol=3e-6)


def test_other_grid_sizes_and_odd_rows() -> None:
    chi, g = np.array([[0.3, -1.2, 0.7], [2.0, 0.1, -0.4]]), np.array([0.4 + 0.1j, -0.5j])
    azimuth, polar = grid(10)
    u = direction(azimuth[None, :], polar[:, None])
    exact = np.abs(np.exp(-2j * np.pi * (u @ chi.T)) @ g) ** 2
    np.testing.assert_allclose(kernel.bartlett_power(chi, g, 10), exact, atol=3e-6)
    with pytest.raises(ValueError, match="even"):
        kernel.bartlett_power(chi, g, 9)


def test_what_is_not_finite_or_silent_is_refused() -> None:
    with pytest.raises(ApertureError, match="not finite"):
        bartlett_profile(np.full((3, 3), np.nan), np.ones(3, np.complex128), 0.05)
    with pytest.raises(ApertureError, match="zero"):
        bartlett_profile(np.zeros((3, 3)), np.zeros(3, np.complex128), 0.05)


@pytest.mark.parametrize("rows", [2, ROWS, 2 * ROWS])
def test_no_packets_change_nothing(rows: int) -> None:
    sums = kernel.empty_sums(rows)
    kernel.add_packets(sums, np.zeros((0, 3)), np.zeros(0, np.complex128))
    assert not sums.any()


def test_is_far_faster_than_the_naive_sum() -> None:
    """About 450 times at 2000 packets on an idle core; 60 leaves room for a busy machine."""
    t, p = weave(2000)
    del t
    chi = p - p.mean(axis=0)
    g = round_trip(p, far(p, direction(1.0, 1.0)))
    kernel.warm_up()
    fast_s = min(_seconds(lambda: bartlett_profile(chi, g, WAVELENGTH_M)) for _ in range(5))
    scaled, columns = chi * (4 * np.pi / WAVELENGTH_M), direction(AZIMUTH_RAD, 1.0)
    row_s = min(_seconds(lambda: np.abs(np.exp(-1j * (columns @ scaled.T)) @ g) ** 2) for _ in range(3))
    ratio = 180 * row_s / fast_s
    print(f"profile of 2000 packets {1e3 * fast_s:.1f} ms, {ratio:.0f} times faster than the naive sum")
    assert ratio > 60


@pytest.mark.long
def test_works_where_no_cache_can_be_written(tmp_path: Path) -> None:
    """In place of unwritable folders, which root can write to: a file where the cache's folder would be, no home."""
    copy = tmp_path / "copied_kernel.py"
    shutil.copy(kernel.__file__, copy)
    (tmp_path / "__pycache__").touch()
    code = (
        "import copied_kernel as k, numpy as np\n"
        "k.bartlett_power(np.zeros((1, 3)), np.ones(1, np.complex128), 2)\n"
        "print(k.__file__)"
    )
    environment = {"PATH": os.environ["PATH"], "HOME": os.devnull, "XDG_CACHE_HOME": os.devnull}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert (done.stderr, done.stdout.strip()) == ("", str(copy))


def _seconds(work: object) -> float:
    assert callable(work)
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
