"""What a ground station is told while the service runs: beside its tasks and not one of them. Off, there is nothing."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any, Final

from companion.autopilot.ground_station import GroundStation
from companion.autopilot.port import AutopilotError
from companion.config.schema import Config
from companion.core.event_clock import EventClock
from companion.core.recorder import Recorder
from companion.flight.announcements import Announcements, named_values
from companion.host.beside import Beside

_LOOK_S: Final = 0.25
"""How late a sentence may be."""


class Ground:
    """`recorder` is what the service records with: it hears what is to be said, where something is."""

    def __init__(self, config: Config, clock: EventClock, recorder: Recorder) -> None:
        self._rate_hz = 0.0 if config.autopilot is None else config.autopilot.ground_hz
        self._clock = clock
        self._announcements: Announcements | None = None
        self._telling = Beside("telling of the ground")
        self.recorder = recorder
        if self.is_on:
            self.recorder = self._announcements = Announcements(recorder)

    @property
    def is_on(self) -> bool:
        return self._rate_hz > 0

    def start(self, status: Callable[[], dict[str, Any]], station: GroundStation) -> None:
        """From now on. `status` is asked for at `ground_hz`, on the event loop."""
        if self._announcements is not None:
            self._telling.start(self._run(self._announcements, status, station))

    async def aclose(self) -> None:
        """Harmless when repeated. What was not said yet is said, if the link is still there."""
        await self._telling.aclose()

    async def _run(
        self, announcements: Announcements, status: Callable[[], dict[str, Any]], station: GroundStation
    ) -> None:
        loop, shown_s = asyncio.get_running_loop(), 0.0
        try:
            while True:
                await asyncio.sleep(_LOOK_S)
                self._say(announcements, station)
                if loop.time() - shown_s >= 1 / self._rate_hz:
                    shown_s = loop.time()
                    with contextlib.suppress(AutopilotError):
                        for name, value in named_values(status()).items():
                            station.show(name, value)
        finally:
            self._say(announcements, station)

    def _say(self, announcements: Announcements, station: GroundStation) -> None:
        for one in announcements.due(self._clock.now_ns()):
            with contextlib.suppress(AutopilotError):  # there is no link, so nobody to hear it
                station.say(one.severity, one.text)
