"""The team of a running service: what its process is told, and what it says, where the configuration asks for it."""

from __future__ import annotations

from typing import Any

from companion.core.messages import Pose
from companion.roles.node import Node
from companion.sensing.records import Iteration
from companion.team.gathering import Gathering
from companion.team.process import TeamProcess
from companion.team.sent import sighting_of
from wsr.displacement import antenna_positions


class TeamOf:
    """Of one node. With `team.enabled` off nothing is gathered, connected or started."""

    def __init__(self, node: Node) -> None:
        config = node.config
        self._antenna_m = config.pose.antenna_m
        self._process: TeamProcess | None = None
        if not config.team.enabled:
            return
        self._gathering = Gathering(config.id, node.book.own_boot_id, node.receiver.neighbours)
        names = {peer.id: peer.name for peer in config.peers}
        self._process = TeamProcess(
            own=config.id, names=names, clock=node.clock, recorder=node.recorder, news=self._gathering.news
        )
        node.poses.connect(self._add_pose)

    def add_iteration(self, iteration: Iteration) -> None:
        """Our own aperture gave a bearing."""
        sighting = None if self._process is None else sighting_of(iteration)
        if sighting is not None:
            self._gathering.add_own_sighting(sighting)

    def start(self) -> None:
        if self._process is not None:
            self._process.start()

    async def aclose(self) -> None:
        if self._process is not None:
            await self._process.aclose()

    def status(self) -> dict[str, Any] | None:
        """None where it is off."""
        return None if self._process is None else self._process.status()

    def _add_pose(self, pose: Pose) -> None:
        if self._gathering.wants_place(pose.t_mono_ns):
            place_m = antenna_positions(pose.p_enu_m, pose.q_enu_from_body, self._antenna_m)
            self._gathering.add_own_place(pose.t_mono_ns, place_m)
