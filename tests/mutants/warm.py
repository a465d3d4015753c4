"""Runs the same tests again and again on code that changes, each time in a fork that has the libraries imported.

`python -m tests.mutants.warm SOCKET PYTEST-ARGUMENTS`; whoever connects gets the exit code of one run as one byte, and
who leaves before ends the run. Libraries are what a first run has imported from outside this folder.
"""

from __future__ import annotations

import importlib
import os
import resource
import select
import signal
import socket
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Final

import pytest

_CPU_S: Final = 30
"""A mutant that never ends is killed after so long, however loaded the machine is."""
_OF_PYTEST: Final = ("pytest_", "_pytest", "_hypothesis", "xdist", "hypothesis")
"""Its plugins, which it wants to import by itself."""


def main() -> int:
    path, arguments = sys.argv[1], sys.argv[2:]
    sys.path.insert(0, str(Path.cwd()))
    known, told = os.pipe()
    if _wait(_run(arguments, told)) != 0:
        print("the tests fail on the module as it is", file=sys.stderr)
        return 1
    os.close(told)
    with os.fdopen(known) as names, warnings.catch_warnings(action="ignore"):
        for name in names.read().split():
            with suppress(ImportError):
                importlib.import_module(name)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path)
        server.listen()
        while True:
            asker, _ = server.accept()
            with asker, suppress(BrokenPipeError):
                asker.send(bytes([_wait(_run(arguments), asker)]))


def _run(arguments: list[str], told: int | None = None) -> int:
    """Process id of a run; with `told` its modules' names go there at its end."""
    child = os.fork()
    if child:
        return child
    os.setsid()
    resource.setrlimit(resource.RLIMIT_CPU, (_CPU_S, _CPU_S))
    sys.dont_write_bytecode = told is None  # mutants follow each other within the second that a .pyc is told apart by
    if told is None:
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
    code = int(pytest.main(arguments))
    if told is not None:
        os.write(told, " ".join(_libraries()).encode()[:60_000])
    os._exit(code)


def _libraries() -> list[str]:
    here = Path.cwd()
    outside = []
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None)
        if file and not Path(file).is_relative_to(here) and not name.startswith(_OF_PYTEST):
            outside.append(name)
    return outside


def _wait(child: int, asker: socket.socket | None = None) -> int:
    """Its exit code; 1 for a signal, and for one that was killed because its asker left."""
    ended = os.pidfd_open(child)
    awaited = [ended] if asker is None else [ended, asker.fileno()]
    select.select(awaited, [], [])
    os.close(ended)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # and all it has started
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) if os.WIFEXITED(status) else 1


if __name__ == "__main__":
    sys.exit(main())
