"""`make mutants`: changes each module in every way cosmic-ray knows and runs its tests; prints the survivors.

Works on a copy in `build/mutants`, since cosmic-ray changes the file it tests. Each `NAME.toml` names a module and the
tests that must notice. Counts are kept in `build/mutants.json`; exit code 1 when a session could not be run.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import shlex
import shutil
import sqlite3
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from tests.mutants.same_program import is_same, skip_most, skip_same

_ROOT: Final = Path(__file__).resolve().parents[2]
_HERE: Final = Path(__file__).resolve().parent
_COPY: Final = _ROOT / "build" / "mutants"
_SESSIONS: Final = _ROOT / "build" / "mutants-tried"
_COUNTS: Final = _ROOT / "build" / "mutants.json"
_COSMIC: Final = _ROOT / ".venv-mutants" / "bin"
_COPIED: Final = ("companion", "wsr", "csi_bridge", "tests", "configs", "docs")
_START_S: Final = 300.0


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("names", nargs="*", help="of tests/mutants/*.toml; all when none is given")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="a sample: each N-th mutant alone")
    parser.add_argument("--survivors", action="store_true", help="try those again that survived the last time")
    options = parser.parse_args()
    names = options.names or sorted(path.stem for path in _HERE.glob("*.toml"))
    _SESSIONS.mkdir(parents=True, exist_ok=True)
    failed = False
    for name in names:
        _copy()
        try:
            with _kept_counts() as counts:
                counts[name] = _session(name, options.survivors, options.every)
        except (subprocess.CalledProcessError, RuntimeError) as error:
            print(f"{name}: {error}", file=sys.stderr)
            failed = True
    return int(failed)


def _copy() -> None:
    shutil.rmtree(_COPY, ignore_errors=True)
    _COPY.mkdir(parents=True)
    for folder in _COPIED:
        shutil.copytree(_ROOT / folder, _COPY / folder, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(_ROOT / "pyproject.toml", _COPY)


def _session(name: str, again: bool, every: int) -> dict[str, Any]:
    """Counts of one module's mutants, after each was tried, or one of `every`; with `again` those that survived the
    last session."""
    settings = tomllib.loads((_HERE / f"{name}.toml").read_text())
    module = settings["cosmic-ray"]["module-path"]
    arguments = shlex.split(settings["cosmic-ray"]["test-command"])[3:]  # after python -m pytest
    socket, session, derived = _COPY / "warm.sock", _SESSIONS / f"{name}.sqlite", _COPY / f"{name}.toml"
    ask = f"{sys.executable} -IS {_HERE / 'ask.py'} {socket}"
    command = settings["cosmic-ray"]["test-command"]
    derived.write_text((_HERE / f"{name}.toml").read_text().replace(json.dumps(command), json.dumps(ask)))
    with _warm(socket, arguments):
        for one in (_COPY / module).parent.glob(f"__pycache__/{Path(module).stem}.*"):
            one.unlink()
        began_s = time.monotonic()
        if again and session.exists():
            with sqlite3.connect(session) as database:
                database.execute("DELETE FROM work_results WHERE test_outcome = 'SURVIVED'")
            database.close()
        else:
            session.unlink(missing_ok=True)
            _cosmic("cosmic-ray", "init", derived, session)
            _cosmic("cr-filter-operators", session, derived)
            skip_same(session, _COPY / module)
            skip_most(session, every)
        _cosmic("cosmic-ray", "exec", derived, session)
    return _told(name, module, session, time.monotonic() - began_s)


def _cosmic(command: str, *arguments: str | Path) -> None:
    subprocess.run([_COSMIC / command, *arguments], cwd=_COPY, check=True, stdout=subprocess.DEVNULL)


@contextlib.contextmanager
def _warm(socket: Path, arguments: list[str]) -> Iterator[None]:
    command = [sys.executable, "-m", "tests.mutants.warm", str(socket), *arguments]
    with subprocess.Popen(command, cwd=_COPY, stdout=subprocess.DEVNULL) as server:
        try:
            ends_s = time.monotonic() + _START_S
            while not socket.exists():
                if server.poll() is not None or time.monotonic() > ends_s:
                    raise RuntimeError(f"the tests did not pass on the module as it is: pytest {shlex.join(arguments)}")
                time.sleep(0.1)
            yield
        finally:
            server.terminate()


def _told(name: str, module: str, session: Path, took_s: float) -> dict[str, Any]:
    with sqlite3.connect(session) as database:
        rows = database.execute(
            "SELECT worker_outcome, test_outcome, diff FROM work_results JOIN mutation_specs USING (job_id) "
            "ORDER BY start_pos_row, start_pos_col, operator_name"
        ).fetchall()
    database.close()
    failed = sum(worker == "EXCEPTION" for worker, _, _ in rows)
    tried = [(test, diff) for worker, test, diff in rows if worker not in ("SKIPPED", "EXCEPTION")]
    source = (_COPY / module).read_text()
    tried = [(test, diff) for test, diff in tried if test == "KILLED" or not is_same(source, diff)]
    survivors = [diff for test, diff in tried if test != "KILLED"]
    print(f"{name}: {module}: {len(tried)} mutants, {len(survivors)} survive, {took_s:.0f} s", flush=True)
    if failed:
        print(f"{name}: {failed} more could not be made: cosmic-ray does not know what stands there", flush=True)
    for diff in survivors:
        print("\n".join(line for line in diff.splitlines() if line[:1] in "+-@" and line[:3] not in ("+++", "---")))
    return {"module": module, "mutants": len(tried), "survivors": len(survivors), "took_s": round(took_s)}


@contextlib.contextmanager
def _kept_counts() -> Iterator[dict[str, Any]]:
    counts: dict[str, Any] = json.loads(_COUNTS.read_text()) if _COUNTS.exists() else {}
    yield counts
    _COUNTS.write_text(json.dumps(counts, indent=1))


if __name__ == "__main__":
    sys.exit(main())
