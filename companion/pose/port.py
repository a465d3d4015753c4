"""What every source of poses is to the rest of the companion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from companion.core.messages import Pose
from companion.host.coalescing import Readers

PoseSink = Callable[[Pose], None]
"""Gets every pose in the order it came, on the event loop: ENU, North-aligned, stamped on the host's monotonic clock.

Numbers may be NaN: a lost tracker sends such poses, and it is the health's part to see that."""


class Poses(Protocol):
    """One source, made with its sink."""

    received: int
    """Poses handed over."""
    malformed: int
    """Pieces of input that were no pose."""
    resets: int
    """Times the tracker began anew, in another frame."""

    def align(self, north_yaw_rad: float) -> None:
        """Turn the frame by so much, counter-clockwise, to true East and North."""

    async def run(self, readers: Readers | None = None) -> None:
        """Delivers until cancelled or, for a recording, until its end. A source whose poses bring their own times has
        its socket read by `readers`; without them, and any other, by the event loop."""

    def close(self) -> None:
        """Let go of what was opened. Harmless when repeated."""
