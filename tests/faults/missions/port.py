"""What senses see of the world around them and of the service that they stand in."""

from __future__ import annotations

import random
from collections.abc import Sequence
from typing import Protocol

from companion.core.messages import Pose
from companion.flight.loop import Flight
from companion.pose.intake import PoseIntake
from companion.sensing.iterations import SarIterations
from tests.faults.missions.scenario import Scenario
from tests.faults.missions.timeless import MissionClock
from tests.faults.missions.vehicle import Vehicle


class Started(Protocol):
    """One start of the service."""

    flight: Flight
    sar: SarIterations
    intake: PoseIntake

    @property
    def senses(self) -> object: ...


class Around(Protocol):
    """The world: its clock and chance, what lasts of its faults, and where it is told what came in."""

    scenario: Scenario
    clock: MissionClock
    rng: random.Random
    vehicle: Vehicle

    def lasts(self, kind: str) -> bool: ...

    def word(self, kind: str) -> str: ...

    def give_poses(self, service: Started, poses: Sequence[Pose]) -> None: ...

    def note_packet(self) -> None: ...

    def note_datagram(self) -> None: ...
