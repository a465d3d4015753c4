"""The AOA worker: a process of its own, below everything else in priority, that turns apertures into estimates.

Started by `companion.sensing.worker_process`; reads requests on standard input and writes results on standard output
until its input ends, which also ends it when the service dies.
"""

from __future__ import annotations

import os
import sys
import time
from multiprocessing import get_context
from pathlib import Path
from typing import BinaryIO

import msgspec
import numpy as np

import wsr
from companion.host.child import die_with_parent
from companion.host.priority import stand_back
from companion.sensing.worker_wire import LENGTH, READY_ID, AoaRequest, AoaResult, aperture_of, frame
from wsr.aoa import Estimator
from wsr.crb.informativeness import Prior, informativeness
from wsr.errors import ApertureError
from wsr.estimators import ESTIMATORS, compile_packets, compile_search, warm_up


def compute(estimator: Estimator, request: AoaRequest, prior: Prior | None = None) -> AoaResult:
    """One estimate; a refusal of the estimator is a result too. `prior` as `wsr.crb.informativeness` takes it."""
    start = time.perf_counter()
    try:
        aperture = aperture_of(request)
        estimate, profile = estimator.estimate(aperture)
    except ApertureError as error:
        return AoaResult(id=request.id, peer=request.peer, compute_s=time.perf_counter() - start, refusal=str(error))
    power = np.asarray(profile.power, np.float16).tobytes()
    told = informativeness(aperture, estimate.azimuth_rad, estimate.polar_rad, prior=prior)
    elapsed_s = time.perf_counter() - start
    return AoaResult(
        id=request.id, peer=request.peer, compute_s=elapsed_s, estimate=estimate, profile=power, informativeness=told
    )


def is_compiled() -> bool:
    """Whether a worker finds machine code from before, as far as can be seen without starting one."""
    place = os.environ.get("NUMBA_CACHE_DIR") or Path(wsr.__path__[0], "__pycache__")
    return any(Path(place).glob("**/kernel.*.nbi"))


def _warm_up(estimator: str, cores: set[int]) -> None:
    """Where no machine code is kept two processes compile half of it each, and this one reads what the other kept.
    Nobody flies without bearings: the other may run on all of `cores`."""
    if estimator == "robust" and not is_compiled():
        beside = get_context("fork").Process(target=_compile_beside, args=(cores,))
        try:
            beside.start()
        except OSError:  # no memory or process more: then this one compiles all
            pass
        else:
            compile_packets()
            beside.join()
    warm_up(estimator)


def _compile_beside(cores: set[int]) -> None:
    die_with_parent()
    with Path(os.devnull).open("wb") as nothing:  # who waits for the end of the worker's output waits for nobody else
        os.dup2(nothing.fileno(), sys.stdout.fileno())
    os.sched_setaffinity(0, cores)
    compile_search()


def main() -> None:
    cores = os.sched_getaffinity(0)
    stand_back(nice=10)
    source, sink = sys.stdin.buffer, sys.stdout.buffer
    estimator = ESTIMATORS[sys.argv[1]]()
    _warm_up(sys.argv[1], cores)
    ready = AoaResult(id=READY_ID, peer=0, compute_s=0.0)
    _write(sink, ready)
    while (request := _read(source)) is not None:
        _write(sink, ready if request.id == READY_ID else compute(estimator, request))


def _read(source: BinaryIO) -> AoaRequest | None:
    head = source.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(head)
    return msgspec.msgpack.decode(source.read(length), type=AoaRequest)


def _write(sink: BinaryIO, result: AoaResult) -> None:
    sink.write(frame(result))
    sink.flush()


if __name__ == "__main__":
    main()
