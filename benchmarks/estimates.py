"""Whole estimates against our own far-field profile, cost over transmitters, and the worker's memory."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import msgspec

from benchmarks.scenes import WAVELENGTH_M, helix
from benchmarks.timing import best_s
from companion.sensing.worker_wire import LENGTH, AoaResult, frame, request_of
from wsr.estimators import ESTIMATORS
from wsr.profile import bartlett_profile

PACKETS = 880
TRANSMITTERS = (1, 2, 4, 8, 16)
AX_WIDTHS_MHZ = (20, 40, 80, 160)


@dataclass(frozen=True, slots=True, kw_only=True)
class EstimateTimes:
    """Seconds at 880 packets with 30 subcarriers in both directions."""

    far_field_profile_s: float
    robust_3d_s: float
    robust_planar_s: float
    links_s: dict[int, float]
    """Estimates of so many transmitters heard in one iteration, in sequence as the worker computes them."""
    ax_s: dict[int, float]
    """`robust` of an AX card's packets by their width in MHz, thinned."""


def estimate_times() -> EstimateTimes:
    robust = ESTIMATORS["robust"]()
    spatial, planar = helix(PACKETS), helix(PACKETS, planar=True)
    links = [helix(PACKETS, seed=seed) for seed in range(max(TRANSMITTERS))]

    def heard(count: int) -> None:
        for aperture in links[:count]:
            robust.estimate(aperture)

    return EstimateTimes(
        far_field_profile_s=best_s(lambda: bartlett_profile(spatial.chi_m, spatial.channel, WAVELENGTH_M)),
        robust_3d_s=best_s(lambda: robust.estimate(spatial)),
        robust_planar_s=best_s(lambda: robust.estimate(planar)),
        links_s={count: best_s(lambda count=count: heard(count), repeats=2) for count in TRANSMITTERS},  # type: ignore[misc]
        ax_s={width: _ax_s(width) for width in AX_WIDTHS_MHZ},
    )


def _ax_s(width_mhz: int) -> float:
    robust, aperture = ESTIMATORS["robust"](), helix(PACKETS, ax_mhz=width_mhz)
    return best_s(lambda: robust.estimate(aperture))


def worker_memory_mb(iterations: int, every: int) -> Iterator[tuple[int, float]]:
    """Resident memory [MB] of a real worker process, each time `every` more requests have been answered."""
    command = [sys.executable, "-m", "companion.sensing.worker", "robust"]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    aperture = helix(400)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment) as worker:
        assert worker.stdin is not None
        assert worker.stdout is not None
        _read(worker.stdout)  # ready
        for number in range(iterations + 1):
            if number % every == 0:
                yield number, _resident_mb(worker.pid)
            worker.stdin.write(frame(request_of(number, 2, aperture)))
            worker.stdin.flush()
            _read(worker.stdout)
        worker.stdin.close()


def _read(source: BinaryIO | object) -> AoaResult:
    assert hasattr(source, "read")
    (length,) = LENGTH.unpack(source.read(LENGTH.size))
    return msgspec.msgpack.decode(source.read(length), type=AoaResult)


def _resident_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text()
    line = next(line for line in status.splitlines() if line.startswith("VmRSS:"))
    return int(line.split()[1]) / 1024
