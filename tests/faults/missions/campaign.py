"""Flies missions and keeps one line of JSON for each; what was flown before is not flown again."""

from __future__ import annotations

import json
import multiprocessing
import resource
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import click

from companion.flight.records import SERVICE_ENDS, MissionStep
from companion.mission.table import TABLE
from tests.faults.missions.fly import fly
from tests.faults.missions.promises import violations
from tests.faults.missions.reality import real
from tests.faults.missions.scenario import draw
from tests.faults.missions.trace import Sent, Trace

_SAY_EVERY_S = 30.0


def trace_of(seed: int, is_real: bool) -> Trace:
    return fly(real(draw(seed)), is_real=True) if is_real else fly(draw(seed))


def flown(seed: int, is_real: bool = False) -> dict[str, Any]:
    """One mission: its row."""
    began_s = time.process_time()
    trace = trace_of(seed, is_real)
    return {
        "seed": seed,
        "faults": [f"{fault.kind} {fault.word}".strip() for fault in trace.scenario.faults],
        "setpoints": len(trace.of(Sent)),
        "steps": _steps(trace),
        "violations": [asdict(one) for one in violations(trace)],
        "cpu_s": round(time.process_time() - began_s, 3),
    }


def _steps(trace: Trace) -> list[str]:
    steps = [step for step in trace.of(MissionStep) if step.reason != SERVICE_ENDS]
    return [f"{step.state} {step.event} {step.next_state}" for step in steps]


def rows(seeds: list[int], jobs: int, is_real: bool) -> Iterator[dict[str, Any]]:
    one = partial(flown, is_real=is_real)
    if jobs == 1:
        yield from map(one, seeds)
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap_unordered(one, seeds, chunksize=8)


def kept(out: Path) -> dict[int, dict[str, Any]]:
    """What was flown before; a last line that was cut is left out."""
    found = {}
    for line in out.read_text().splitlines() if out.exists() else []:
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if "seed" in row:
            found[row["seed"]] = row
    return found


def _met(flown_rows: list[dict[str, Any]]) -> int:
    """How many pairs of state and event of the table the missions went through."""
    taken = {tuple(step.split()[:2]) for row in flown_rows for step in row["steps"]}
    return sum((str(state), str(event)) in taken for state, event in TABLE)


@click.command()
@click.option("--count", default=5000, show_default=True, help="Missions in all, those flown before among them.")
@click.option("--first", default=0, show_default=True, help="Seed of the first.")
@click.option("--jobs", default=1, show_default=True)
@click.option("--real", "is_real", is_flag=True, help="Radio, cameras, window, worker and estimator computed.")
@click.option(
    "--out", type=click.Path(path_type=Path), help="Default: build/missions.jsonl, build/missions-real.jsonl."
)
@click.option("--trace", "shown", type=int, help="Fly this seed alone and print its trace.")
def main(count: int, first: int, jobs: int, is_real: bool, out: Path | None, shown: int | None) -> None:
    """Random fault missions; exit code 1 when a promise of docs/safety.md was broken."""
    if shown is not None:
        trace = trace_of(shown, is_real)
        for entry in trace.entries:
            print(entry)
        found = violations(trace)
        print(*found, sep="\n")
        sys.exit(bool(found))
    out = out or Path("build/missions-real.jsonl" if is_real else "build/missions.jsonl")
    out.parent.mkdir(parents=True, exist_ok=True)
    wanted = range(first, first + count)
    before = {seed: row for seed, row in kept(out).items() if seed in wanted}
    began_s = said_s = time.monotonic()
    done, broken = Counter[str](), list[dict[str, Any]]()
    with out.open("a") as file:
        if file.tell() and not out.read_bytes().endswith(b"\n"):
            file.write("\n")
        for number, row in enumerate(rows([seed for seed in wanted if seed not in before], jobs, is_real), 1):
            file.write(json.dumps(row) + "\n")
            file.flush()
            broken += [row] if row["violations"] else []
            if row["violations"]:
                print(f"seed {row['seed']}: {row['violations']}", flush=True)
            if time.monotonic() - said_s > _SAY_EVERY_S:
                said_s = time.monotonic()
                print(f"{len(before) + number} of {count}, {said_s - began_s:.0f} s, {len(broken)} broken", flush=True)
    everything = [row for seed, row in kept(out).items() if seed in wanted]
    for row in everything:
        done.update(one["promise"] for one in row["violations"])
    used = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"{len(everything)} missions, {sum(row['setpoints'] for row in everything)} set points; now "
        f"{len(everything) - len(before)} in {time.monotonic() - began_s:.0f} s, "
        f"{sum(one.ru_utime + one.ru_stime for one in used):.0f} s of processor, in all "
        f"{sum(row['cpu_s'] for row in everything):.0f}; {_met(everything)} of {len(TABLE)} steps of the table taken; "
        f"broken promises: {dict(done) or 'none'}"
    )
    sys.exit(bool(done))
