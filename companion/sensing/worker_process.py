"""The service's end of the AOA worker: hands it apertures, notices when it hangs or dies, starts another."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sys
from typing import Final

import msgspec

from companion.core.output import Output
from companion.errors import CompanionError
from companion.host.child import tied
from companion.sensing.worker_wire import LENGTH, MAX_BYTES, READY_ID, SIGN_OF_LIFE, AoaResult, frame, request_of
from wsr.aperture import Aperture

_log = logging.getLogger(__name__)
_START_S = 60.0  # the first start compiles the kernel, slowly on an Atom; later ones read the cache
_RESTART_S = 0.5
_AGAIN_S = 2.0
_LOOK_S = 0.5
_LATE_S = 1.0
"""A worker with nothing to do is asked for a sign of life this often. One that owes it for so long is not ready."""
ONE_THREAD: Final = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


class AoaProcess:
    """Computes one aperture at a time in a niced process. `answers` gives every result, refusals included.

    A request that takes longer than `timeout_s`, or during which the worker dies, is answered with a refusal, and the
    worker is replaced. One that has nothing to do and hangs or dies is not ready within 1.5 s, and is replaced too. At
    most `waiting` requests queue; the oldest goes first when there are more. `readiness` tells when a worker begins and
    ceases to wait for requests.
    """

    def __init__(self, estimator: str, timeout_s: float, waiting: int = 16) -> None:
        self._estimator = estimator
        self._timeout_s = timeout_s
        self.answers = Output[AoaResult]()
        self.readiness = Output[bool]()
        self._requests: asyncio.Queue[tuple[int, int, Aperture]] = asyncio.Queue(waiting)
        self._next_id = 0
        self._spawns = True
        self.restarts = 0
        self.ready = asyncio.Event()
        """Set while a worker waits for requests."""

    def submit(self, peer: int, aperture: Aperture) -> int:
        """Queues an aperture and returns the id its result will carry."""
        if self._requests.full():
            dropped_id, dropped_peer, _ = self._requests.get_nowait()
            refusal = AoaResult(
                id=dropped_id, peer=dropped_peer, compute_s=0.0, refusal="the AOA worker is behind", failed=True
            )
            # An answer is an event of its own, never a part of the one that submits.
            asyncio.get_running_loop().call_soon(self.answers.give, refusal)
        request_id, self._next_id = self._next_id, self._next_id + 1
        self._requests.put_nowait((request_id, peer, aperture))
        return request_id

    async def run(self) -> None:
        """Serves requests until cancelled; never leaves a process behind."""
        while True:
            try:
                process = await _spawn(self._estimator)
            except OSError as error:  # no memory, or no process more: the flight goes on without bearings
                if self._spawns:
                    _log.error("the AOA worker cannot be started: %s; trying again", error.strerror)
                self._spawns = False
                await asyncio.sleep(_AGAIN_S)
                continue
            self._spawns = True
            try:
                await self._serve(process)
            except (TimeoutError, asyncio.IncompleteReadError, ConnectionError) as error:
                self.restarts += 1
                _log.warning(
                    "AOA worker %d %s; starting another, restart %d",
                    process.pid,
                    _what_happened(error),
                    self.restarts,
                )
            finally:
                self._set_ready(False)
                await _end(process)
            await asyncio.sleep(_RESTART_S)

    async def _serve(self, process: asyncio.subprocess.Process) -> None:
        async with asyncio.timeout(_START_S):
            started = await _receive(process)
        if started.id != READY_ID:
            raise CompanionError("the AOA worker answered before it was asked")
        self._set_ready(True)
        while True:
            try:
                async with asyncio.timeout(_LOOK_S):
                    request_id, peer, aperture = await self._requests.get()
            except TimeoutError:
                await self._see_it_lives(process)
                continue
            try:
                async with asyncio.timeout(self._timeout_s):
                    await _send(process, frame(request_of(request_id, peer, aperture)))
                    result = await _receive(process)
            except (TimeoutError, asyncio.IncompleteReadError, ConnectionError) as error:
                reason = f"the AOA worker {_what_happened(error)}"
                self.answers.give(AoaResult(id=request_id, peer=peer, compute_s=0.0, refusal=reason, failed=True))
                raise
            self.answers.give(result)

    async def _see_it_lives(self, process: asyncio.subprocess.Process) -> None:
        """Raises TimeoutError, or as pipes do, when it does not."""
        await _send(process, frame(SIGN_OF_LIFE))
        answer = asyncio.ensure_future(_receive(process))
        try:
            if not (await asyncio.wait({answer}, timeout=_LATE_S))[0]:
                self._set_ready(False)
            async with asyncio.timeout(self._timeout_s):
                await answer
        finally:
            answer.cancel()
        self._set_ready(True)

    def _set_ready(self, is_ready: bool) -> None:
        if is_ready != self.ready.is_set():
            (self.ready.set if is_ready else self.ready.clear)()
            self.readiness.give(is_ready)


async def compile_kernel(estimator: str) -> None:
    """Has a worker start and end, so that the next one need not compile. Takes ten seconds and more of processor."""
    process = await _spawn(estimator)
    try:
        assert process.stdin is not None
        process.stdin.close()
        await process.communicate()
    finally:
        await _end(process)


async def _spawn(estimator: str) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *tied(sys.executable, "-m", "companion.sensing.worker", estimator),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        env=os.environ | ONE_THREAD,
    )


async def _send(process: asyncio.subprocess.Process, data: bytes) -> None:
    assert process.stdin is not None
    process.stdin.write(data)
    await process.stdin.drain()


async def _receive(process: asyncio.subprocess.Process) -> AoaResult:
    assert process.stdout is not None
    (length,) = LENGTH.unpack(await process.stdout.readexactly(LENGTH.size))
    if length > MAX_BYTES:
        raise ConnectionError(f"announced {length} bytes")
    try:
        return msgspec.msgpack.decode(await process.stdout.readexactly(length), type=AoaResult)
    except msgspec.DecodeError as error:  # a library has printed into it
        raise ConnectionError(f"sent what is no answer: {error}") from None


async def _end(process: asyncio.subprocess.Process) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    await process.wait()


def _what_happened(error: Exception) -> str:
    return "did not answer in time" if isinstance(error, TimeoutError) else "died"
