"""The machine: interpreter, packages, compiled kernel, clocks, disk."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import companion
from companion.config.schema import Config
from companion.radio.checks import Check
from companion.shipped.files import shipped_text

_OLDEST: Final = (3, 11)
_CACHE: Final = Path("/var/cache/companion")
_FIRST_YEAR: Final = 2026
"""No clock that was ever set is behind the program."""
_EXACT: Final = {"mavsdk"}
_SLOW_CLOCKS: Final = {"hpet", "acpi_pm", "jiffies"}
_SHOWN: Final = 4


def machine_checks(config: Config, root: Path) -> Iterator[Check]:
    """`root` is where the kernel's and the system's files are: / but in tests."""
    yield _interpreter()
    yield _packages()
    yield _kernel_cache(root)
    yield from _clocks(root)
    yield from _disk(config)


def _interpreter() -> Check:
    found = f"{platform.python_implementation()} {platform.python_version()}, companion {companion.__version__}, "
    ok = sys.version_info >= _OLDEST and platform.python_implementation() == "CPython"
    return Check("interpreter", ok, found + sys.prefix, "" if ok else "CPython 3.11 or newer: make PYTHON=python3.11")


def _packages() -> Check:
    pinned = dict(re.findall(r"^([\w.-]+)==([\w.]+)", shipped_text("requirements.txt"), re.MULTILINE))
    missing, other = [], []
    for name, wanted in pinned.items():
        try:
            found = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
            continue
        if found != wanted:
            other.append(f"{name} {found} in place of {wanted}")
    wrong = missing + [one for one in other if one.split()[0] in _EXACT]
    if wrong:
        return Check(
            "packages", False, f"missing or wrong: {', '.join(wrong[:_SHOWN])}", "pip install -r requirements.txt"
        )
    differ = (
        f"; {len(other)} others than were tested: {', '.join(other[:_SHOWN])}" if other else ", as they were tested"
    )
    return Check("packages", True, f"{len(pinned)} are there{differ}")


def _kernel_cache(root: Path) -> Check:
    place = Path(os.environ.get("NUMBA_CACHE_DIR", root / _CACHE.relative_to("/")))
    try:
        compiled = any(place.glob("**/kernel.*.nbi"))
    except OSError:
        compiled = False
    if compiled:
        return Check("compiled kernel", True, f"kept in {place}")
    return Check(
        "compiled kernel", None, f"none in {place}",
        "companion-setup warm-up, as root; else the first start compiles it, which takes a minute or more",
    )  # fmt: skip


def _clocks(root: Path) -> Iterator[Check]:
    try:
        source = (root / "sys/devices/system/clocksource/clocksource0/current_clocksource").read_text().strip()
    except OSError:
        yield Check("clock source", None, "cannot be read")
    else:
        slow = source in _SLOW_CLOCKS
        yield Check(
            "clock source", not slow, source, "a slow one: dmesg says why the kernel left its own" if slow else ""
        )
    year = time.gmtime().tm_year
    ok = year >= _FIRST_YEAR
    synchronized = (root / "run/systemd/timesync/synchronized").exists()
    found = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime()) + (", synchronized" if synchronized else "")
    remedy = "" if ok else "date --set: the times in logs are of this clock; nothing in flight is"
    yield Check("wall clock", ok, found, remedy)


def _disk(config: Config) -> Iterator[Check]:
    for name, folder in (
        ("disk of the log", config.path(config.recorder.path).parent),
        ("state folder", config.path(config.state_dir)),
    ):
        try:
            free_mib = shutil.disk_usage(folder).free / 2**20
        except OSError as error:
            yield Check(name, None, f"{folder}: {error.strerror}", "systemd makes it when the service starts")
            continue
        ok = free_mib >= config.recorder.min_free_mib
        budget = f"{free_mib / 1024:.1f} GiB free at {folder}"
        remedy = f"nothing engages below recorder.min_free_mib ({config.recorder.min_free_mib:g}): remove old logs"
        yield Check(name, ok, budget, "" if ok else remedy)
