"""A switch on the pilot's transmitter that engages and aborts. Pure."""

from __future__ import annotations

from companion.config.schema import AutopilotConfig
from companion.core.inputs import Event


class RcSwitch:
    """Moving the switch up engages, moving it down aborts; how it stands at the start, or after RC was lost, means
    nothing, so that no engagement happens by itself."""

    def __init__(self, channel: int, above_us: int) -> None:
        """`channel` counts from 1, as transmitters do."""
        self._index = channel - 1
        self._above_us = above_us
        self._was_up: bool | None = None

    def update(self, rc_us: tuple[int, ...]) -> Event | None:
        """The wish that the newest pulse widths make; without RC there is none."""
        is_known = self._index < len(rc_us) and 800 <= rc_us[self._index] <= 2200
        before, self._was_up = self._was_up, (rc_us[self._index] > self._above_us) if is_known else None
        if before is None or self._was_up is None or before is self._was_up:
            return None
        return Event.ENGAGE if self._was_up else Event.ABORT


def configured_switch(config: AutopilotConfig) -> RcSwitch | None:
    """The one that a configuration names, if it names one."""
    channel = config.engage_rc_channel
    return None if channel is None else RcSwitch(channel, config.engage_rc_above_us)
