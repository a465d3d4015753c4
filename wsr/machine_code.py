"""Numba's machine code as this package wants it: what a process compiles is what the next one reads, to the last digit.

Machine code is cached next to the files it is of, or where NUMBA_CACHE_DIR says, or nowhere if nothing can be written.
The first call of a process loads it, or compiles it for some seconds: a worker calls `warm_up` before it reports ready.
"""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import config, njit
from numba.core import caching
from numba.core.codegen import get_host_cpu_features
from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., object])
_CONSTANTS = bool, int, float, complex, str, np.generic


def compiled(function: Function) -> Function:
    """Machine code for a function. `reassoc` lets the compiler add packets in vector lanes, `contract` use fused
    multiply-add; no flag assumes NaN away."""
    return _compiled(function)


def shared(function: Function) -> Function:
    """The same for a function that Python and other compiled ones call.

    It is part of the machine code of each that calls it, always. Where the compiler may choose, each of them brings a
    copy of its own that rounds in its own way, and the copy that a process happens to load first serves them all: one
    that compiles would not give the last digits of one that reads the cache, and a flight not those of its replay."""
    return _compiled(function, forceinline=True)


def inner(function: Function) -> Function:
    """The same for a function that only other compiled ones call: there is less to compile without its entrances."""
    return _compiled(function, forceinline=True, no_cpython_wrapper=True)


def _compiled(function: Function, **more: Any) -> Function:
    options: dict[str, Any] = {"fastmath": {"reassoc", "contract", "nsz"}, "error_model": "numpy"} | more
    # For C's callers, of whom there are none.
    options |= {"no_cfunc_wrapper": True}
    try:
        return cast(Function, njit(cache=True, **options)(function))
    except RuntimeError:
        # There is no place to write a cache to; then every process compiles for itself.
        return cast(Function, njit(**options)(function))


class _WithWhatItCalls:
    """Numba takes cached code for fresh while the function's own file is unchanged. But what it calls from other files,
    and their constants, are in that code too: they are part of the stamp here."""

    def __init__(self, function: Callable[..., object], file: str) -> None:
        super().__init__(function, file)  # type: ignore[call-arg]
        self._function = function

    def get_source_stamp(self) -> bytes:
        return source_digest(self._function)


class GivenFolder(_WithWhatItCalls, caching.UserProvidedCacheLocator):  # type: ignore[misc]
    """Where NUMBA_CACHE_DIR says."""


class BesideSource(_WithWhatItCalls, caching.InTreeCacheLocator):  # type: ignore[misc]
    """In `__pycache__` next to the file."""


class UsersFolder(_WithWhatItCalls, caching.UserWideCacheLocator):  # type: ignore[misc]
    """In the user's cache folder."""


def source_digest(function: Callable[..., object]) -> bytes:
    """SHA-256 of all that a function's machine code is made of: its file, the constants that the file's names stand for
    so far, and the same of every compiled function it knows from another file."""
    module = inspect.getmodule(function)
    found = hashlib.sha256(inspect.getsource(module or function).encode())
    for name, value in sorted(inspect.unwrap(function).__globals__.items()):
        if isinstance(value, Dispatcher) and inspect.getmodule(of := value.py_func) is not module:
            found.update(name.encode() + source_digest(of))
        elif isinstance(value, np.ndarray):
            found.update(name.encode() + value.tobytes())
        elif isinstance(value, _CONSTANTS) and not name.startswith("__"):
            found.update(f"{name}={value!r}".encode())
    return found.digest()


def _cache_by_what_is_called() -> None:
    """Whoever chooses where Numba looks for its cache is left with it."""
    settings = vars(config)
    if not settings["CACHE_LOCATOR_CLASSES"]:
        own = (GivenFolder, BesideSource, UsersFolder)
        named = [f"{__name__}.{one.__name__}" for one in own]
        settings["CACHE_LOCATOR_CLASSES"] = ",".join([*named, "IPythonCacheLocator", "ZipCacheLocator"])


def _use_whole_registers() -> None:
    """LLVM uses half of each 512-bit register where some relatives of a processor slow down in whole ones; sums as long
    as these gain a fifth from whole ones all the same. Whoever chooses a processor for Numba is left with it."""
    settings, features = vars(config), get_host_cpu_features()
    if settings["CPU_NAME"] is None and settings["CPU_FEATURES"] is None and "+avx512f" in features:
        settings["CPU_FEATURES"] = features + ",-prefer-256-bit"


_cache_by_what_is_called()
_use_whole_registers()
