"""Our transmissions on the card's own interface: pings of the flying robot, or answers of a beacon in user space."""

from __future__ import annotations

from typing import Final

from companion.config.schema import Config
from companion.core.clock import Clock, Ticker
from companion.errors import CompanionError
from companion.radio.traffic import SYSFS
from csi_bridge.injector import CHECK_SUM_BYTES, Injector, InjectorError, echo_frame, ping_frame

MONITOR: Final = 803
"""ARPHRD_IEEE80211_RADIOTAP of if_arp.h: an interface in monitor mode."""


class Pinger:
    """Role uav: pings the beacons in turn, one counter for each. Role beacon: answers every ping of its length.

    Answers from user space leave a millisecond or more after the ping, not 0.3 ms; what that costs is in docs/radio.md.
    """

    def __init__(self, config: Config, injector: Injector, clock: Clock, mac: bytes) -> None:
        self._injector = injector
        self._mac = mac
        self._lengths = [peer.ack_length for peer in config.peers] if config.role == "uav" else []
        self._own_length = config.ack_length - CHECK_SUM_BYTES
        self._ticker = Ticker(clock, config.ping.rate_hz)
        self.answered = 0

    def fileno(self) -> int:
        return self._injector.fileno()

    async def run(self) -> None:
        """Pings until cancelled; a beacon only answers, in `drain`."""
        number = 0
        async for _ in self._ticker.ticks():
            if self._lengths:
                turn, which = divmod(number, len(self._lengths))
                # Each beacon gets 1, 2, 3, ..: what answers to what is told by counter and MAC.
                self._injector.send(ping_frame(self._mac, turn + 1, self._lengths[which]))
                number += 1

    def drain(self) -> None:
        """Called when the interface has captured something."""
        for ping in self._injector.captured():
            if not self._lengths and ping.length == self._own_length and ping.mac != self._mac:
                self.answered += self._injector.send(echo_frame(ping, self._mac, ping.length))

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
        injector = Injector(config.csi.interface, config.ping.mcs)
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
        return bytes.fromhex((SYSFS / interface / "address").read_text().strip().replace(":", ""))
    except (OSError, ValueError):
        raise CompanionError(f"csi.interface {interface}: there is no such interface") from None
