"""Commands on logs as tests call them, and what they are called with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from companion.core.streams import VEHICLE
from tests.golden.golden_logs import GOLDEN
from tests.ulog_file import ulog_of

Run = Callable[..., tuple[int, str, str]]
"""Exit code, standard output and standard error of `companion ARGUMENTS`."""


FLIGHT = GOLDEN[0]


def write_ulog(path: Path, session: Any, scale: float = 1.0, part: slice = slice(None)) -> int:
    """The vehicle's positions as PX4 logs them, NED, on a clock of its own; wall time of its boot."""
    rows = []
    for message in session.messages({VEHICLE.topic}):
        state = msgspec.json.decode(message.data)
        if state["p_local_enu_m"] is not None:
            rows.append((state["position_mono_ns"] + session.wall_minus_mono_ns, state["p_local_enu_m"]))
    boot_ns = rows[0][0] - 5_000_000_000
    ned = [((t_ns - boot_ns) // 1000, (north * scale, east * scale, -up * scale)) for t_ns, (east, north, up) in rows]
    path.write_bytes(ulog_of(ned[part]))
    return int(boot_ns)
