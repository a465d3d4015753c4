"""What a fault test measured, kept in one JSON file that the table in docs is made from."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

_DEFAULT = Path(__file__).parents[2] / "build" / "fault-figures.json"


def record(number: int, **figures: Any) -> None:
    """Adds the figures of fault `number` of the fault table, and prints them. A later run of the same figure wins."""
    path = Path(os.environ.get("FAULT_FIGURES", _DEFAULT))
    path.parent.mkdir(parents=True, exist_ok=True)
    known: dict[str, dict[str, Any]] = json.loads(path.read_text()) if path.exists() else {}
    known[f"{number:02d}"] = known.get(f"{number:02d}", {}) | figures
    path.write_text(json.dumps(dict(sorted(known.items())), indent=2) + "\n")
    print(f"fault {number}: {', '.join(f'{name} {value}' for name, value in figures.items())}")
