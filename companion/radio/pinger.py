"""Our transmissions on the card's own interface: pings of the flying robot, or answers of a beacon in user space."""

from __future__ import annotations

import random
from typing import Final

from companion.config.schema import Config
from companion.core.clock import NS_PER_S, Clock, Ticker
from companion.errors import CompanionError
from companion.radio.opening import mac_bytes
from companion.radio.traffic import SYSFS
from csi_bridge.injector import CHECK_SUM_BYTES, Injector, InjectorError, Ping, echo_frame, ping_frame

MONITOR: Final = 803
"""ARPHRD_IEEE80211_RADIOTAP of if_arp.h: an interface in monitor mode."""
_MOST_LATE: Final = 0.5
"""Of a period: how long a ping without a counter may wait."""


class Pinger:
    """Role uav: pings the beacons in turn, one counter for each. Role beacon: answers every ping of its length or,
    among AX cards, to its address.

    Answers from user space leave a millisecond or more after the ping, not 0.3 ms; what that costs is in docs/radio.md.
    An AX card reports no counters, and packets are paired by their times: between its pings lie random ones, since
    those of even ones fit at every period.
    """

    def __init__(self, config: Config, injector: Injector, clock: Clock, mac: bytes) -> None:
        self._injector = injector
        self._mac = mac
        self._clock = clock
        self._by_address = config.csi.source == "nl80211"
        peers = config.peers if config.role == "uav" else []
        self._beacons = [(peer.ack_length, mac_bytes(peer.mac) if self._by_address else None) for peer in peers]
        self._own_length = config.ack_length - CHECK_SUM_BYTES
        self._ticker = Ticker(clock, config.ping.rate_hz)
        self._late_ns = round(_MOST_LATE * NS_PER_S / config.ping.rate_hz) if self._by_address else 0
        self.answered = 0

    def fileno(self) -> int:
        return self._injector.fileno()

    async def run(self) -> None:
        """Pings until cancelled; a beacon only answers, in `drain`."""
        number = 0
        async for now_ns in self._ticker.ticks():
            if self._beacons:
                if self._late_ns:
                    await self._clock.sleep_until_ns(now_ns + random.randrange(self._late_ns))
                turn, which = divmod(number, len(self._beacons))
                length, to = self._beacons[which]
                # Each beacon gets 1, 2, 3, ..: what answers to what is told by counter and MAC.
                self._injector.send(ping_frame(self._mac, turn + 1, length, to))
                number += 1

    def drain(self) -> None:
        """Called when the interface has captured something."""
        for ping in self._injector.captured():
            if not self._beacons and ping.mac != self._mac and self._is_for_us(ping):
                self.answered += self._injector.send(echo_frame(ping, self._mac, ping.length))

    def _is_for_us(self, ping: Ping) -> bool:
        if self._by_address:
            return ping.to == self._mac
        return ping.to is None and ping.length == self._own_length

    def health(self) -> dict[str, float]:
        injector = self._injector
        return {
            "sent": injector.sent,
            "sent_bytes": injector.sent_bytes,
            "unsent": injector.unsent,
            "answered": self.answered,
            "overruns": self._ticker.overruns,
        }

    def close(self) -> None:
        self._injector.close()


def open_pinger(config: Config, clock: Clock) -> Pinger | None:
    """None where the configuration does not ask for one. Raises CompanionError."""
    if not config.ping.enabled or config.csi.interface is None:
        return None
    kind = interface_kind(config.csi.interface)
    if kind != MONITOR:
        raise CompanionError(
            f"csi.interface {config.csi.interface}: it is not in monitor mode (type {kind}, expected {MONITOR}), and "
            "pings are no frames for another one: companion doctor radio says how to set it"
        )
    try:
        vht_mhz = config.csi.width_mhz if config.csi.source == "nl80211" else None
        injector = Injector(config.csi.interface, config.ping.mcs, vht_mhz)
        return Pinger(config, injector, clock, interface_mac(config.csi.interface))
    except InjectorError as error:
        raise CompanionError(f"csi.interface {error.strerror}") from None


def interface_kind(interface: str) -> int:
    """ARPHRD_* of an interface. Raises CompanionError where there is no such one."""
    try:
        return int((SYSFS / interface / "type").read_text())
    except (OSError, ValueError):
        raise CompanionError(f"csi.interface {interface}: there is no such interface") from None


def interface_mac(interface: str) -> bytes:
    """Raises CompanionError where there is no such interface."""
    try:
        return mac_bytes((SYSFS / interface / "address").read_text().strip())
    except (OSError, ValueError):
        raise CompanionError(f"csi.interface {interface}: there is no such interface") from None
