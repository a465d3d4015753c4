"""Where a node's inputs come from: the card, the camera, the radio link and the files of a robot, or a log."""

from __future__ import annotations

from typing import Protocol

from companion.config.schema import Config
from companion.core.clock import Clock
from companion.errors import ConfigError
from companion.neighbours.boots import Book, BootBook
from companion.neighbours.keys import read_key
from companion.pose.opening import open_poses
from companion.pose.port import Poses, PoseSink
from companion.radio.opening import open_csi
from companion.radio.pinger import Pinger, open_pinger
from csi_bridge.source import CsiSource


class Inputs(Protocol):
    """What a node reads from. Opening raises CompanionError where something is missing."""

    def open_csi(self) -> CsiSource: ...

    def open_poses(self, clock: Clock, sink: PoseSink) -> Poses:
        """The source of poses; each pose goes to `sink`."""

    def open_book(self) -> Book: ...

    def open_pinger(self, clock: Clock) -> Pinger | None: ...

    def key(self, name: str) -> bytes:
        """The key in the file `name` of the configuration."""


class LiveInputs:
    """The inputs of `config` on this machine."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._keys: dict[bytes, str] = {}
        """Those read before, by what they hold."""

    def open_csi(self) -> CsiSource:
        return open_csi(self._config)

    def open_poses(self, clock: Clock, sink: PoseSink) -> Poses:
        return open_poses(self._config, clock, sink)

    def open_book(self) -> Book:
        return BootBook(self._config.path(self._config.state_dir))

    def open_pinger(self, clock: Clock) -> Pinger | None:
        return open_pinger(self._config, clock)

    def key(self, name: str) -> bytes:
        path = self._config.path(name)
        key = read_key(path)
        other = self._keys.setdefault(key, name)
        if self._owner(other) != self._owner(name):
            raise ConfigError(
                f"{path}: holds the same key as {other}; each robot has its own, or one could speak for another "
                "(companion keygen makes one)"
            )
        return key

    def _owner(self, name: str) -> int:
        """The robot whose key the file `name` holds: a peer may have two while they are being replaced."""
        peers = (peer.id for peer in self._config.peers if name in (peer.key_file, peer.next_key_file))
        return next(peers, self._config.id)
