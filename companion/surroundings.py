"""What an engagement looks at beyond the event loop: the disk, the link, what was asked of the autopilot."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Surroundings:
    """One look, recorded with the event that looked."""

    t_mono_ns: int
    autopilot_problem: str
    """Why there is no connection to the autopilot; empty while there is one."""
    parameters_checked: bool
    """The autopilot's parameters were found as required a moment ago."""
    bad_signatures: int
    """Datagrams in the target's name with a wrong signature; anybody can send them, so they are not recorded."""
    recorder_failed: bool
    free_mib: float
    """On the log's disk."""
