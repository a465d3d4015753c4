"""What stands in for radio, apertures and estimator: a target that is heard, and bearings to it that are drawn."""

from __future__ import annotations

import asyncio
import math
import random
from collections import deque
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from companion.core.clock import NS_PER_S
from companion.core.messages import Pose, Vector3
from companion.host.coalescing import Readers
from companion.neighbours.neighbour import Neighbour
from companion.radio.card import ChannelSample
from companion.sensing.iterations import SarIterations
from companion.sensing.window import ApertureReport
from companion.sensing.worker_wire import AoaResult
from companion.study.virtual_parts import BEACON_ID
from tests.faults.missions.port import Around, Started
from tests.faults.missions.timeless import MissionClock
from tests.level_pose import level_pose
from wsr.aoa import AoaEstimate
from wsr.aperture import Aperture

_BOOT = 1
_NO_CSI = np.zeros((30, 3), np.complex64)
_ORIGIN_M: Vector3 = (3.0, -2.0, 0.4)
"""The target counts its own poses from here."""
_NOTHING = ((0.0, 0.0, 0.0),) * 3
_T_S = np.array([0.0, 1.0])
_APERTURE = Aperture(
    t_s=_T_S, chi_m=np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]), channel=np.ones(2, np.complex128),
    wavelength_m=0.05, reference_p_m=(0.0, 0.0, 0.0), reference_t_s=0.5,
)  # fmt: skip


class FoundNeighbour(Neighbour):
    """A target whose clock relation and poses are given instead of measured."""

    __slots__ = ("at_m", "clock_lost")

    def __init__(self, at_m: Vector3) -> None:
        super().__init__(BEACON_ID, "beacon")
        self.at_m = at_m
        self.clock_lost = False

    def not_locked(self, now_ns: int) -> str:
        return "the clock of beacon is not related to ours" if self.clock_lost else ""

    def newest_pose(self) -> tuple[int, Vector3] | None:
        if self.heard_ns is None:
            return None
        x, y, z = (p - o for p, o in zip(self.at_m, _ORIGIN_M, strict=True))
        return _BOOT, (x, y, z)


class DrawnWindow:
    """Cuts an aperture out of nothing, unless the vehicle hardly moved."""

    def __init__(self, clock: MissionClock) -> None:
        self._clock = clock
        self._path: deque[tuple[int, Vector3]] = deque(maxlen=1200)

    def note(self, p_m: Vector3) -> None:
        self._path.append((self._clock.t_ns, p_m))

    def at(self, t_ns: int) -> Vector3:
        return min(self._path, key=lambda one: abs(one[0] - t_ns))[1]

    def body_at(self, t_ns: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
        times_ns, places_m = np.array([t for t, _ in self._path]), np.array([p for _, p in self._path])
        return np.stack([np.interp(t_ns, times_ns, places_m[:, axis]) for axis in range(3)], axis=1)

    def path_length_m(self, start_ns: int, end_ns: int) -> float:
        places = [p for t_ns, p in self._path if start_ns <= t_ns <= end_ns]
        return sum(map(math.dist, places, places[1:]))

    def start_of_path(self, not_before_ns: int, end_ns: int, length_m: float) -> int | None:
        gone_m = 0.0
        for (until_ns, b), (t_ns, a) in pairwise(reversed(self._path)):
            if t_ns < not_before_ns or gone_m >= length_m:
                break
            gone_m += math.dist(a, b) if until_ns <= end_ns else 0.0
            start_ns = t_ns
        return start_ns if gone_m >= length_m else None

    def cut(self, neighbour: FoundNeighbour, start_ns: int, end_ns: int) -> ApertureReport:
        is_long = self.path_length_m(start_ns, end_ns) > 0.2
        x, y, z = (p - o for p, o in zip(neighbour.at_m, _ORIGIN_M, strict=True))
        return ApertureReport(
            peer=neighbour.id, start_ns=start_ns, end_ns=end_ns, received=100, power_dbm=-60.0, dropped={},
            aperture=_APERTURE if is_long else None, refusal="" if is_long else "too short",
            peer_t_s=_T_S, peer_p_m=np.array([[x, y, z], [x, y, z]]), peer_boot=_BOOT,
        )  # fmt: skip


class NoPoses:
    """A source of poses that gives none by itself: they are drawn."""

    received = malformed = resets = 0

    def align(self, north_yaw_rad: float) -> None: ...

    async def run(self, readers: Readers | None = None) -> None: ...

    def close(self) -> None: ...


class DrawnSenses:
    """What one start of the service has in place of window, worker, poses and the receiver of datagrams."""

    def __init__(self, world: Around) -> None:
        clock, step_ns = world.clock, world.scenario.step_ns
        target = FoundNeighbour(world.scenario.target_enu_m)
        self._target = target
        self.window = DrawnWindow(clock)
        self.worker = DrawnWorker(world.rng, clock, self.window, target)
        self.neighbours: dict[int, Neighbour] = {BEACON_ID: target}
        count = 2 if step_ns < NS_PER_S // 15 else 3
        self._poses_ago_ns = [step_ns * i // count for i in reversed(range(count))]

    def on_pose(self, pose: Pose) -> None: ...

    @property
    def is_related(self) -> bool:
        return not self._target.clock_lost

    def apply(self, world: Around) -> None:
        self._target.clock_lost = world.lasts("clock")
        self.worker.does = world.word("worker")

    def turn(self, world: Around, service: Started) -> None:
        now_ns, airframe = world.clock.t_ns, world.vehicle.airframe
        self.window.note(airframe.estimated_p_enu_m)
        p_m, v_m_s = airframe.p_enu_m, airframe.v_enu_m_s
        world.give_poses(
            service,
            [level_pose(now_ns - ago_ns, p_m, v_m_s) for ago_ns in self._poses_ago_ns],
        )
        if not world.lasts("packets"):
            service.flight.knowledge.heard(
                ChannelSample(peer=BEACON_ID, frame=None, t_mono_ns=now_ns, nic_us=0, channel=_NO_CSI, power_dbm=-50.0)
            )
            world.note_packet()
        if not world.lasts("datagrams"):
            self._target.heard_ns = now_ns
            world.note_datagram()
        self.worker.give(service.sar)


class DrawnWorker:
    """Bearings to the target with drawn errors, after a drawn time. `does` says what is wrong with it, if anything."""

    def __init__(self, rng: random.Random, clock: MissionClock, window: DrawnWindow, target: FoundNeighbour) -> None:
        self._rng, self._clock, self._window, self._target = rng, clock, window, target
        self.ready = asyncio.Event()
        self.ready.set()
        self.does = ""
        self._answers: list[tuple[int, AoaResult]] = []
        self._next_id = 0
        self.span_ns = (0, 0)

    def submit(self, peer: int, aperture: Any) -> int:
        request_id, self._next_id = self._next_id, self._next_id + 1
        due_ns = self._clock.t_ns + round(self._rng.uniform(0.05, 0.5) * NS_PER_S)
        self._answers.append((due_ns, self._result(request_id, peer)))
        return request_id

    def give(self, sar: SarIterations) -> None:
        if self.does in ("hangs", "gone"):
            return
        due = [one for one in self._answers if one[0] <= self._clock.t_ns]
        self._answers = [one for one in self._answers if one[0] > self._clock.t_ns]
        for _, result in due:
            sar.take_answer(result)

    def _result(self, request_id: int, peer: int) -> AoaResult:
        if self.does == "lost":
            return AoaResult(id=request_id, peer=peer, compute_s=0.1, refusal="the worker was lost", failed=True)
        if self.does == "refuses" or self._rng.random() < 0.05:
            return AoaResult(id=request_id, peer=peer, compute_s=0.1, refusal="too few packets")
        here, there = self._window.at(self._clock.t_ns - NS_PER_S), self._target.at_m
        wrong = self.does == "lies" or self._rng.random() < 0.05
        azimuth = math.atan2(there[1] - here[1], there[0] - here[0]) + self._rng.gauss(0, 0.05)
        azimuth = self._rng.uniform(-math.pi, math.pi) if wrong else math.remainder(azimuth, math.tau)
        polar = math.acos(max(-1.0, min(1.0, (there[2] - here[2]) / max(math.dist(here, there), 1e-6))))
        return AoaResult(
            id=request_id,
            peer=peer,
            compute_s=0.1,
            estimate=_estimate(azimuth, polar, 0.05 if self.does == "doubts" else 0.8),
        )


def _estimate(azimuth_rad: float, polar_rad: float, reliability: float) -> AoaEstimate:
    return AoaEstimate(
        azimuth_rad=azimuth_rad, polar_rad=polar_rad, azimuth_std_rad=0.05, polar_std_rad=0.2, covariance=_NOTHING,
        crb_rad=0.02, coherence=0.9, reliability=reliability, azimuth_observable=True, polar_observable=True,
        alternatives=(), packets=100, length_m=1.0, extents_m=(1.0, 0.2, 0.1), reference_p_m=(0.0, 0.0, 0.0),
        reference_t_s=0.5,
    )  # fmt: skip
