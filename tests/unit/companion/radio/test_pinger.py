"""Who sends pings, and on what interface."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Literal

import pytest

from companion.config.schema import Config, CsiConfig, NeighbourConfig, Peer, PingConfig
from companion.core.clock import MonotonicClock
from companion.errors import CompanionError
from companion.radio.pinger import Pinger, open_pinger
from csi_bridge.injector import Ping, parse_capture, radiotap
from tests.manual_clock import ManualClock


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


class _Sending:
    """An injector that keeps what is sent, and captures what it is given."""

    sent = sent_bytes = unsent = 0

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.heard: list[Ping] = []

    def send(self, frame: bytes) -> bool:
        self.frames.append(frame)
        return True

    def captured(self) -> list[Ping]:
        heard, self.heard = self.heard, []
        return heard


_OWN, _ELSE = bytes.fromhex("00216a000001"), bytes.fromhex("00216a000009")
_PEERS = [Peer(2, "a", "00:21:6A:00:00:02", "k", ack_length=57), Peer(3, "b", "00:21:6A:00:00:03", "k", ack_length=61)]


def _config(role: Literal["uav", "beacon"], source: Literal["netlink", "nl80211"] = "netlink") -> Config:
    return Config(
        role=role, id=1, name="x", csi=CsiConfig(108, interface="mon0", source=source),
        neighbours=NeighbourConfig(key_file="k"), peers=_PEERS, ping=PingConfig(enabled=True, rate_hz=50),
        ack_length=57,
    )  # fmt: skip


async def test_beacons_are_pinged_in_turn_and_each_counts_by_itself() -> None:
    injector = _Sending()
    pinger = Pinger(_config("uav"), injector, ManualClock(), _OWN)  # type: ignore[arg-type]
    running = asyncio.create_task(pinger.run())
    while len(injector.frames) < 6:  # noqa: ASYNC110 - until so many are sent
        await asyncio.sleep(0)
    running.cancel()
    pings = [parse_capture(radiotap(1) + frame) for frame in injector.frames[:6]]
    assert [(ping.counter, ping.length) for ping in pings if ping] == [(n, k) for n in (1, 2, 3) for k in (53, 57)]
    assert {ping.mac for ping in pings if ping} == {_OWN}


def test_a_beacon_answers_pings_of_its_own_length_and_nobody_elses_answers() -> None:
    injector = _Sending()
    pinger = Pinger(_config("beacon"), injector, ManualClock(), _OWN)  # type: ignore[arg-type]
    injector.heard = [Ping(_ELSE, 7, 53), Ping(_ELSE, 8, 57), Ping(_OWN, 9, 53), Ping(_ELSE, 10, 53, _OWN)]
    pinger.drain()
    (answer,) = (parse_capture(radiotap(1) + frame) for frame in injector.frames)
    assert answer == Ping(_OWN, 7, 54)
    assert pinger.health()["answered"] == 1


def test_among_ax_cards_it_answers_what_names_it() -> None:
    injector = _Sending()
    pinger = Pinger(_config("beacon", "nl80211"), injector, ManualClock(), _OWN)  # type: ignore[arg-type]
    injector.heard = [Ping(_ELSE, 7, 53), Ping(_ELSE, 8, 53, _ELSE), Ping(_ELSE, 9, 53, _OWN)]
    pinger.drain()
    (answer,) = (parse_capture(radiotap(1) + frame) for frame in injector.frames)
    assert answer == Ping(_OWN, 9, 54, _ELSE)


def test_who_is_not_asked_to_ping_opens_nothing() -> None:
    config = _config("uav")
    assert open_pinger(replace(config, ping=PingConfig(enabled=False)), MonotonicClock()) is None
    assert open_pinger(replace(config, csi=CsiConfig(108)), MonotonicClock()) is None
