"""Where a node's inputs come from: the card, the camera, the radio link and the files of a robot, or a log."""

from __future__ import annotations

from typing import Protocol

from companion.boots import Book, BootBook
from companion.clock import Clock
from companion.config import Config
from companion.errors import CompanionError
from companion.keys import read_key
from companion.pinger import Pinger, open_pinger
from companion.pose.intake import PoseIntake
from companion.pose.opening import open_poses
from companion.pose.port import Poses, PoseSink
from csi_bridge.netlink import NetlinkError, NetlinkSource
from csi_bridge.source import CsiSource
from csi_bridge.unix_socket import UnixSocketError, UnixSource


class Inputs(Protocol):
    """What a node reads from. Opening raises CompanionError where something is missing."""

    def open_csi(self) -> CsiSource: ...

    def open_poses(self, clock: Clock, intake: PoseIntake, sink: PoseSink) -> Poses:
        """The source of poses, bound to the intake; each pose goes to `sink`."""

    def open_book(self) -> Book: ...

    def open_pinger(self, clock: Clock) -> Pinger | None: ...

    def key(self, name: str) -> bytes:
        """The key in the file `name` of the configuration."""


class LiveInputs:
    """The inputs of `config` on this machine."""

    def __init__(self, config: Config) -> None:
        self._config = config

    def open_csi(self) -> CsiSource:
        csi = self._config.csi
        try:
            if csi.source == "unix":
                return UnixSource(self._config.path(csi.socket), csi.receive_buffer_bytes)
            return NetlinkSource(csi.connector_idx, csi.require_kernel_sender, csi.receive_buffer_bytes)
        except (NetlinkError, UnixSocketError) as error:
            raise CompanionError(f"csi.source {csi.source}: {error.strerror}") from None

    def open_poses(self, clock: Clock, intake: PoseIntake, sink: PoseSink) -> Poses:
        return open_poses(self._config, clock, intake, sink)

    def open_book(self) -> Book:
        return BootBook(self._config.path(self._config.state_dir))

    def open_pinger(self, clock: Clock) -> Pinger | None:
        return open_pinger(self._config, clock)

    def key(self, name: str) -> bytes:
        return read_key(self._config.path(name))
