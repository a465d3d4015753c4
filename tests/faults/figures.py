"""Each fault test writes its figure to one JSON file, of which the table in the documentation is made."""

from __future__ import annotations

import fcntl
import json
import os
from pathlib import Path
from typing import Final

_DEFAULT: Final = Path("build/fault-figures.json")


def record(number: int, **figures: float | int | str) -> None:
    """Adds the figures of fault `number` to the file that FAULT_FIGURES names, and prints them."""
    path = Path(os.environ.get("FAULT_FIGURES", _DEFAULT))
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        content = json.loads(file.read() or "{}")
        content.setdefault(str(number), {}).update(figures)
        file.truncate(0)
        file.write(json.dumps(content, indent=2, sort_keys=True) + "\n")
    print(f"fault {number}: " + ", ".join(f"{name} {value}" for name, value in figures.items()))
