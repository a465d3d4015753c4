"""What ground stations hear of us, over the autopilot's link: sentences and named values, addressed to nobody.

An autopilot or a router hands such messages on. MAVLink common.xml 253 (STATUSTEXT) and 251 (NAMED_VALUE_FLOAT).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final, Protocol

CHUNK: Final = 50
"""Characters of one STATUSTEXT."""
MOST_CHUNKS: Final = 4
NAME: Final = 10
"""Characters of the name of a value."""
_IDS: Final = 65535


class MavlinkSender(Protocol):
    def send(self, name: str, /, **fields: Any) -> None: ...


class GroundStation:
    """`boot_ms` tells the vehicle's own time since its start, with which values are stamped."""

    def __init__(self, link: MavlinkSender, boot_ms: Callable[[], int]) -> None:
        self._link = link
        self._boot_ms = boot_ms
        self._id = 0

    def say(self, severity: int, text: str) -> None:
        """A sentence, severity as in syslog. Raises AutopilotError when the link is closed."""
        parts = chunks(text)
        self._id = self._id % _IDS + 1 if len(parts) > 1 else self._id
        number = self._id if len(parts) > 1 else 0
        for place, part in enumerate(parts):
            self._link.send("STATUSTEXT", severity=severity, text=part, id=number, chunk_seq=place)

    def show(self, name: str, value: float | None) -> None:
        """A value; NaN for None. Raises AutopilotError when the link is closed."""
        known = None if value is None or not math.isfinite(value) else value
        self._link.send("NAMED_VALUE_FLOAT", time_boot_ms=self._boot_ms(), name=name[:NAME], value=known)


def chunks(text: str) -> list[str]:
    """A text as STATUSTEXT has it: ASCII, in pieces; what is too long ends with dots. By being shorter the last piece
    shows that it is the last: an empty one follows where it would be full."""
    plain = " ".join(text.encode("ascii", "replace").decode().split())
    most = CHUNK * MOST_CHUNKS - 1
    plain = plain if len(plain) <= most else f"{plain[: most - 3]}..."
    if len(plain) <= CHUNK:
        return [plain]
    return [plain[at : at + CHUNK] for at in range(0, len(plain) + 1, CHUNK)]
