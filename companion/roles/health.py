"""Counters and ages of every input, once a second."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Health:
    """Counters and ages of every input, once a second."""

    t_mono_ns: int
    radio: dict[str, int]
    source: dict[str, int]
    pose_age_s: float | None
    poses: dict[str, Any]
    link: dict[str, int]
    neighbours: dict[str, dict[str, Any]]
    recorder: dict[str, int]
    antenna_dbm: dict[str, float | None] = field(default_factory=dict)
    ping: dict[str, float] = field(default_factory=dict)
    interfaces: dict[str, float] = field(default_factory=dict)
    """Bytes per second sent at each interface of the configuration, as the kernel counts them."""
    lookalikes: tuple[tuple[str, str], ...] = ()
    """Pairs of neighbours whose profiles cannot be told apart."""
    card_clock: dict[str, float] = field(default_factory=dict)
    network_problem: str = ""
    """Why robots cannot be heard or reached; empty while they can."""
