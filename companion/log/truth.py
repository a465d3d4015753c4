"""What really was, beside a log: written by the simulator or taken from motion capture, never seen by the service."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from companion.core.messages import Vector3
from companion.core.streams import TRUTH
from companion.errors import CompanionError
from companion.host.whole_file import whole_file
from companion.log.writer import LogWriter

TRUTH_NAME: Final = "truth.mcap"
"""Found beside a log by `companion report`."""


@dataclass(frozen=True, slots=True)
class Truth:
    """True positions of the antennas at one time of the service's monotonic clock, ENU from one common origin."""

    t_mono_ns: int
    antenna_enu_m: Vector3
    peers_enu_m: Mapping[str, Vector3]
    """By the name of the peer."""


def write_truth(path: Path, truths: Sequence[Truth]) -> None:
    """A log of nothing but the truth, on this host's clocks. Raises CompanionError."""
    offset_ns = time.time_ns() - time.monotonic_ns()
    try:
        with whole_file(path) as file:
            writer = LogWriter(file, {"role": "truth", "wall_minus_mono_ns": str(offset_ns)})
            for truth in truths:
                t_ns = truth.t_mono_ns + offset_ns
                writer.write(TRUTH, t_ns, t_ns, 0, message=truth)
            writer.finish()
    except OSError as error:
        raise CompanionError(f"{path}: cannot be written: {error.strerror}") from None
