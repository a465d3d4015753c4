"""`companion analyze` as tests call it, and what they look at in its results."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TX_PLACE = (3.0, 6.0, 2.5)
"""Where the transmitter of the synthetic run stands."""


@dataclass(frozen=True)
class Ended:
    code: int
    out: str
    err: str


Cli = Callable[..., Ended]


def links(path: Path) -> dict[str, dict[str, Any]]:
    content = json.loads(path.read_text())
    return {link["tx"]: link for run in content["runs"] for link in run["links"]}


def one_line(outcome: Ended) -> bool:
    return len(outcome.err.strip().splitlines()) == 1 and "Traceback" not in outcome.err and not outcome.out.strip()
