"""Trials on a Dask cluster: a scheduler somewhere, or `local:N` workers of our own on this machine.

The scheduler gives the work of a worker that died to another one, so a lost worker costs time and nothing else.
Needs the extra `cluster` (dask.distributed), here and on the workers, and the same version of this package there.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any, TypeVar

from numpy.random import SeedSequence

from companion.errors import ConfigError
from companion.study.trials import RunnerError, TrialError, batches, run_batch

S = TypeVar("S")
R = TypeVar("R")

_CONNECT_S = 10.0
_LOCAL = "local:"


class DaskRunner:
    """A client of the scheduler at `address` ("tcp://HOST:PORT" or "local:N"). A context manager.

    Raises ConfigError when the extra is missing or the address is no address, RunnerError when nobody answers there.
    """

    def __init__(self, address: str) -> None:
        try:
            distributed: Any = importlib.import_module("distributed")
        except ImportError:
            raise ConfigError("--cluster needs dask.distributed: pip install 'wsr-companion[cluster]'") from None
        self._distributed = distributed
        self._address = address
        self._closing = ExitStack()
        try:
            target = self._local_cluster(distributed) if address.startswith(_LOCAL) else address
            self._client: Any = self._closing.enter_context(distributed.Client(target, timeout=_CONNECT_S))
        except OSError as error:
            self._closing.close()
            raise RunnerError(f"--cluster {address}: no Dask scheduler answers: {error}") from None
        except ValueError as error:
            self._closing.close()
            expected = "expected tcp://HOST:PORT of a Dask scheduler, or local:N"
            raise ConfigError(f"--cluster {address}: {error}; {expected}") from None
        self._workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        if not self._workers:
            self._closing.close()
            raise RunnerError(f"--cluster {address}: the scheduler has no workers")

    def __enter__(self) -> DaskRunner:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._closing.close()

    @property
    def name(self) -> str:
        return f"Dask at {self._address}, {self._workers} workers"

    def run(
        self,
        trial: Callable[[S, SeedSequence], R],
        specs: Sequence[S],
        seed: int,
        on_done: Callable[[int, list[R]], None],
    ) -> list[R]:
        """As `TrialRunner.run`."""
        distributed = self._distributed
        todo = list(batches(specs, seed, self._workers))
        futures = {self._client.submit(run_batch, trial, batch, pure=False): batch for batch in todo}
        rows: dict[int, list[R]] = {}
        try:
            for future in distributed.as_completed(futures):
                batch = futures[future]
                rows[batch.first] = future.result()
                on_done(batch.first, rows[batch.first])
        except distributed.KilledWorker as error:
            raise TrialError(f"workers died again and again over the same trials: {error}") from None
        except (OSError, distributed.CancelledError) as error:
            raise RunnerError(f"the scheduler at {self._address} is gone: {error}") from None
        finally:
            self._client.cancel(list(futures))
        return [row for first in sorted(rows) for row in rows[first]]

    def _local_cluster(self, distributed: Any) -> Any:
        """Workers on loopback, one thread each; its status page takes any free port there."""
        count = int(self._address.removeprefix(_LOCAL))
        if count < 1:
            raise ValueError(f"{count} workers")
        return self._closing.enter_context(
            distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                memory_limit=None,
            )
        )
