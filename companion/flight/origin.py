"""Where on Earth a vehicle without GPS stands: told once, on the ground, where PX4 has no origin of its own."""

from __future__ import annotations

import logging
from typing import Final

from companion.autopilot.port import Autopilot, AutopilotError
from companion.config.schema import AutopilotConfig
from companion.core.clock import NS_PER_S, age_s
from companion.core.messages import VehicleState

_log = logging.getLogger(__name__)
_AGAIN_NS: Final = 2 * NS_PER_S
_FRESH_S: Final = 2.0


class Origin:
    """Without an origin PX4 1.16 has no global position, and without that neither hold nor return. It is given once the
    estimator takes our poses, never in the air and never over another one; after a restart of the vehicle again."""

    def __init__(self, autopilot: Autopilot, config: AutopilotConfig) -> None:
        self._autopilot = autopilot
        self._place_deg = config.origin_deg
        self._wanted = not config.gps and config.forward_vio_hz > 0
        self._told_ns: int | None = None

    def tick(self, vehicle: VehicleState, now_ns: int) -> None:
        if not self._wanted or vehicle.position_is_global is not False or not vehicle.estimator_healthy:
            return
        if vehicle.armed or vehicle.in_air or age_s(vehicle.estimator_mono_ns, now_ns) > _FRESH_S:
            return
        if self._told_ns is not None and now_ns - self._told_ns < _AGAIN_NS:
            return
        self._told_ns = now_ns
        try:
            self._autopilot.set_origin(*self._place_deg)
        except AutopilotError as error:
            _log.warning("the origin was not sent: %s", error)
            return
        _log.info("the vehicle has no origin: it is told to be at latitude %g, longitude %g", *self._place_deg)
