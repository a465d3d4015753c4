"""Where a node's inputs come from: the card, the camera, the radio link and the key files of a robot, or a log."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Protocol

from companion.config import Config
from companion.errors import CompanionError
from companion.messages import Pose
from companion.neighbours import open_link, read_key
from companion.pose.source import PoseSource
from csi_bridge.netlink import NetlinkError, NetlinkSource
from csi_bridge.source import CsiSource
from csi_bridge.unix_socket import UnixSocketError, UnixSource


class PoseInput(Protocol):
    """A non-blocking source of poses, for `loop.add_reader(source.fileno(), source.drain)`."""

    received: int
    malformed: int
    not_finite: int

    def fileno(self) -> int: ...

    def drain(self) -> None:
        """Hands over all poses that wait."""

    def close(self) -> None: ...


class Inputs(Protocol):
    """What a node reads from. Opening raises CompanionError where something is missing."""

    def open_csi(self) -> CsiSource: ...

    def open_poses(self, on_pose: Callable[[Pose], None]) -> PoseInput: ...

    def key(self, name: str) -> bytes:
        """The key in the file `name` of the configuration."""

    async def open_link(self, on_datagram: Callable[[bytes], None]) -> asyncio.DatagramTransport: ...


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
            raise CompanionError(f"csi.source {csi.source}: {error}") from None

    def open_poses(self, on_pose: Callable[[Pose], None]) -> PoseInput:
        pose = self._config.pose
        return PoseSource(self._config.path(pose.socket), math.radians(pose.north_yaw_deg), on_pose)

    def key(self, name: str) -> bytes:
        return read_key(self._config.path(name))

    async def open_link(self, on_datagram: Callable[[bytes], None]) -> asyncio.DatagramTransport:
        return await open_link(self._config, on_datagram)
