"""Who sends pings, and on what interface."""

from __future__ import annotations

from dataclasses import replace

import pytest

from companion.config.schema import Config, CsiConfig, NeighbourConfig, PingConfig
from companion.core.clock import MonotonicClock
from companion.errors import CompanionError
from companion.radio.pinger import open_pinger


def test_nothing_is_sent_on_an_interface_that_is_no_monitor() -> None:
    config = Config(
        role="uav",
        id=1,
        name="uav",
        csi=CsiConfig(108, interface="lo"),
        neighbours=NeighbourConfig(key_file="k"),
        peers=[],
        ping=PingConfig(enabled=True),
    )
    with pytest.raises(CompanionError, match=r"csi.interface lo: it is not in monitor mode \(type 772, expected 803\)"):
        open_pinger(config, MonotonicClock())
    missing = replace(config, csi=CsiConfig(108, interface="nosuch0"))
    with pytest.raises(CompanionError, match="nosuch0: there is no such interface"):
        open_pinger(missing, MonotonicClock())
