"""The checks and all tests side by side, as `make test` runs them: `python -m tests.lanes`.

A lane is one command. The AOA kernels are compiled first, once, beside the checks; then all lanes run at once. What
lives in real time waits most of the time and takes what little it needs at once; what computes is niced to the last and
takes all that is left. A lane is printed when it has ended; while it runs its output is in build/test/. docs/testing.md
has a table of where the time goes.

A test that failed beside the others is judged once more alone, and the last lines say so: beside four other lanes on
two cores a test can fail of the company it was in.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from companion.host.child import die_with_parent
from companion.sensing.worker_process import ONE_THREAD

_ROOT: Final = Path(__file__).resolve().parents[1]
_OUT: Final = _ROOT / "build" / "test"
_PYTEST: Final = (sys.executable, "-m", "pytest", "--durations=40", "--processor=40")
_NICE: Final = ("nice", "-n", "19")
_KERNELS: Final = "kernels"
_INTERRUPTED: Final = 130
_INTERRUPTS: Final = (signal.SIGINT, signal.SIGTERM)
_TESTS_FAILED: Final = 1
_END_S: Final = 20.0
_BYTECODE: Final = {"PYTHONDONTWRITEBYTECODE": ""}
"""Some machines have it set, and then every process compiles all modules and every worker rewrites all tests anew."""

_KEPT: Final = {"MALLOC_MMAP_THRESHOLD_": str(32 << 20), "MALLOC_TRIM_THRESHOLD_": str(256 << 20)}
"""The C library gives an array above 128 kB back to the kernel as soon as it is free, and the next one is then new
memory that faults page by page: in a virtual machine more than half the time of an operation on arrays of half a
megabyte. Not for flights: they are flown as a robot runs."""


@dataclass(frozen=True, slots=True)
class Lane:
    """One command and where its output goes."""

    name: str
    command: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)
    """What is set beside what there is."""
    alone: tuple[str, ...] = ()
    """The command that judges its failures once more, when nothing else runs."""
    waits: bool = False
    """It begins when the AOA kernels are compiled, else at once."""

    @property
    def output(self) -> Path:
        return _OUT / f"{self.name}.txt"


def _real_time(name: str, *paths: str) -> Lane:
    """Modules and folders of tests/sitl, one after the other."""
    return _again_alone(name, (*_PYTEST, *(f"tests/sitl/{path}" for path in paths)))


def _again_alone(name: str, command: tuple[str, ...], environment: Mapping[str, str] | None = None) -> Lane:
    """A lane of tests that remembers which of them failed."""
    command = (*command, "-o", f"cache_dir={_OUT / name}.cache")
    # What an earlier run left of failures is no answer to this one.
    again = (*command, "--last-failed", "--last-failed-no-failures", "none")
    return Lane(name, (*command, "--cache-clear"), environment or {}, alone=again, waits=True)


_FLIGHTS: Final = (
    ("flight", "flight"),
    ("demo", "test_demo.py", "test_mission.py", "test_observe.py"),
)
"""Those that take longest, in lanes of about the same length; all others of tests/sitl share one more."""


_COMPUTING: Final = (
    "tests/property", "tests/golden", "tests/faults", "tests/unit/wsr",
    *(f"tests/unit/companion/{room}" for room in ("guidance", "flight", "log", "sensing", "study")),
)  # fmt: skip
"""About half of what computes; the other half of tests/unit has a lane of its own. Two lanes and not the workers of
one, who would all read all modules, and take three milliseconds of processor to tell of a test."""


def _computing(name: str, *words: str) -> Lane:
    # A thread each: where there are more of BLAS than cores, they spin for each other.
    return _again_alone(name, (*_NICE, *_PYTEST, *words), ONE_THREAD | _KEPT)


def lanes() -> list[Lane]:
    """Those that take longest first, of those that begin together."""
    named = {path for _, *paths in _FLIGHTS for path in paths}
    sitl = _ROOT / "tests" / "sitl"
    # A folder shares its fixtures, so it is one.
    every = {path.relative_to(sitl).parts[0] for path in sitl.rglob("test_*.py")}
    return [
        Lane(_KERNELS, (sys.executable, "-m", "companion.sensing.worker", "robust")),
        Lane("checks", (*_NICE, "make", "--silent", "check")),
        *(_real_time(*lane) for lane in _FLIGHTS),
        _real_time("edges", *sorted(every - named)),
        _computing("computing", *_COMPUTING),
        _computing("units", "tests/unit", *(f"--ignore={path}" for path in _COMPUTING)),
    ]


def run(chosen: list[Lane]) -> int:
    """Runs them all, whatever fails. The exit code: 0 when all is well, 1 when not, 130 when it was interrupted."""
    _OUT.mkdir(parents=True, exist_ok=True)
    print(f"{', '.join(lane.name for lane in chosen)}: while they run see {_OUT}/*.txt", flush=True)
    began_s = time.monotonic()
    running = dict[int, tuple[Lane, subprocess.Popen[bytes]]]()
    waiting = [lane for lane in chosen if lane.waits]
    lines, failed = list[str](), list[tuple[Lane, int]]()
    try:
        _start_all([lane for lane in chosen if not lane.waits], running)
        while running:
            pid, status, used = os.wait3(0)
            lane, process = running.pop(pid)
            process.returncode = code = os.waitstatus_to_exitcode(status)
            failed += [(lane, code)] * (code != 0)
            if lane.name == _KERNELS:
                _start_all(waiting, running)
            lines.append(
                f"{lane.name:>10} {'passed' if code == 0 else f'FAILED ({code})'}: {time.monotonic() - began_s:.0f} s, "
                f"of which {used.ru_utime + used.ru_stime:.0f} s of processor"
            )
            print(f"\n{lane.output.read_text(errors='replace').strip()}\n{lines[-1]}", flush=True)
    except KeyboardInterrupt:
        print("\ninterrupted", flush=True)
        _end([process for _, process in running.values()])
        return _INTERRUPTED
    print("", *lines, sep="\n", flush=True)
    # A lane that was killed or never began has not said which of its tests failed.
    alone = [code == _TESTS_FAILED and _passes_alone(lane) for lane, code in failed]
    return int(not all(alone))


def _passes_alone(lane: Lane) -> bool:
    if not lane.alone:
        return False
    print(f"\n{lane.name}: what failed beside the other lanes, once more alone", flush=True)
    passed = subprocess.run(lane.alone, cwd=_ROOT, env=_environment(lane), check=False).returncode == 0
    print(f"{lane.name:>10} {'passed alone' if passed else 'FAILED alone too'}", flush=True)
    return passed


def _start_all(chosen: list[Lane], running: dict[int, tuple[Lane, subprocess.Popen[bytes]]]) -> None:
    """One by one into `running`, by process id. An interrupt waits while one begins, so that it finds all that have."""
    for lane in chosen:
        signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPTS)
        try:
            process = _start(lane)
            running[process.pid] = lane, process
        finally:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, _INTERRUPTS)


def _start(lane: Lane) -> subprocess.Popen[bytes]:
    with lane.output.open("wb") as output:
        return subprocess.Popen(
            lane.command, cwd=_ROOT, env=_environment(lane), stdin=subprocess.DEVNULL, stdout=output,
            stderr=output, process_group=0, preexec_fn=_begin,
        )  # fmt: skip


def _environment(lane: Lane) -> dict[str, str]:
    return os.environ | _BYTECODE | dict(lane.environment)


def _begin() -> None:
    """In the child, which inherits the mask."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _INTERRUPTS)
    die_with_parent()


def _end(processes: list[subprocess.Popen[bytes]]) -> None:
    """An interrupt to each, on which pytest ends its tests; whoever is left of what they started is killed."""
    for number in (signal.SIGINT, signal.SIGKILL):
        for process in processes:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, number)
        deadline_s = time.monotonic() + _END_S
        for process in processes:
            with suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline_s - time.monotonic()))


def main() -> None:
    # Set anew, since a shell has what it starts in the background ignore the one, and Python ends at the other.
    for number in _INTERRUPTS:
        signal.signal(number, signal.default_int_handler)
    sys.exit(run(lanes()))


if __name__ == "__main__":
    main()
