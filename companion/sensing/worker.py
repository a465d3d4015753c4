"""The AOA worker: a process of its own, below everything else in priority, that turns apertures into estimates.

Started by `companion.sensing.worker_process`; reads requests on standard input and writes results on standard output
until its input ends, which also ends it when the service dies.
"""

from __future__ import annotations

import sys
import time
from typing import BinaryIO

import msgspec
import numpy as np

from companion.host.priority import stand_back
from companion.sensing.worker_wire import LENGTH, READY_ID, AoaRequest, AoaResult, aperture_of, frame
from wsr.aoa import Estimator
from wsr.crb.informativeness import Prior, informativeness
from wsr.errors import ApertureError
from wsr.estimators import ESTIMATORS, warm_up


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


def main() -> None:
    stand_back(nice=10)
    source, sink = sys.stdin.buffer, sys.stdout.buffer
    estimator = ESTIMATORS[sys.argv[1]]()
    warm_up(sys.argv[1])
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
