"""Who is where in the team: takes raw sightings and places of all robots, gives each one's place relative to this one.

Raw measurements alone come in, each once: what a robot concluded is never sent, so nothing that this robot said comes
back to it as news.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt

from companion.core.clock import NS_PER_S
from companion.core.messages import Vector3
from companion.team.factors import AZIMUTH_STD_RAD, ELEVATION_STD_RAD, INVERSE_RANGE_STD, Sightings
from companion.team.placing import is_sure, largest_std_m, other_guesses, supported
from companion.team.records import Member, RawSighting, TeamState
from companion.team.smoother import (
    Between,
    Problem,
    Solution,
    WindowPrior,
    first_prior,
    marginalised,
    moved,
    solve,
    step_covariance,
)
from companion.team.tracks import Track

Array = npt.NDArray[np.float64]
Times = npt.NDArray[np.int64]

PERIOD_NS: Final = 2 * NS_PER_S
KEYFRAMES: Final = 30
"""A minute."""
_TRIED_STEPS: Final = 4
_VAGUER: Final = (5.0, 2.5)


class Relative(NamedTuple):
    """Of the robots other than this one, in their order: place in our axes and heading against ours, (N - 1, 4), and
    the covariance of all of it (4 (N - 1), 4 (N - 1))."""

    state: Array
    covariance: Array


class Team:
    """`own` is this robot's id, `others` all that it may hear of."""

    def __init__(self, own: int, others: Sequence[int]) -> None:
        self._ids = (own, *others)
        self._index = {robot: i for i, robot in enumerate(self._ids)}
        self._tracks = {robot: Track() for robot in self._ids}
        self._raw: list[RawSighting] = []
        self._known: set[tuple[int, int, int, int]] = set()
        self._first = 0
        """Number of the oldest keyframe."""
        self._states = np.zeros((0, len(self._ids), 4))
        self._prior: WindowPrior = first_prior(len(self._ids))
        self._pairs: dict[tuple[int, int], int] = {}
        """Keyframe at which each pair was first seen."""
        self._turns = 0

    def add_place(self, robot: int, t_ns: int, p_m: Vector3, boot: int) -> None:
        """Where a robot was by its own poses."""
        if robot in self._index:
            self._tracks[robot].add(t_ns, p_m, boot)

    def add_sighting(self, sighting: RawSighting) -> bool:
        """False for one that was here before, or says nothing: repeated, reordered or replayed it counts once."""
        key = _key(sighting)
        known = sighting.observer in self._index and sighting.target in self._index
        if key in self._known or not known or sighting.observer == sighting.target or sighting.fresh <= 0.0:
            return False
        self._known.add(key)
        self._raw.append(sighting)
        return True

    def update(self, now_ns: int) -> TeamState | None:
        """All that is known now; None before this robot's first place."""
        if self._tracks[self._ids[0]].newest_ns is None:
            return None
        self._extend(now_ns)
        problem = self._problem()
        solution = self._looked_elsewhere(problem, solve(problem, self._states))
        self._states, self._newest = solution.states, solution
        return self._told(now_ns, solution, problem)

    def relative(self, now_ns: int) -> Relative:
        """After `update`: the newest keyframe carried on to now."""
        return self._carried(now_ns, self._newest)

    # window ---------------------------------------------------------------------------------------------------------

    def _extend(self, now_ns: int) -> None:
        last = now_ns // PERIOD_NS
        if not len(self._states) or last - (self._first + len(self._states)) > KEYFRAMES:
            self._begin(last)
        while self._first + len(self._states) <= last:
            k = self._first + len(self._states)
            after = moved(self._states[-1:], self._between(k - 1, 1))
            self._states = np.concatenate([self._states, after])
        while len(self._states) > KEYFRAMES:
            self._prior = marginalised(self._problem(), self._states)
            self._states = self._states[1:]
            self._first += 1
            start_ns = self._first * PERIOD_NS - PERIOD_NS // 2
            self._raw = [sighting for sighting in self._raw if sighting.t_ns >= start_ns]
            # Numbers come round, after nine hours of two bearings a second: only those of the window are the same one.
            self._known = {_key(sighting) for sighting in self._raw}
        for track in self._tracks.values():
            track.forget_before((self._first - 1) * PERIOD_NS)

    def _begin(self, last: int) -> None:
        """Far behind, or at the very beginning: the window starts anew."""
        oldest = min((s.t_ns for s in self._raw), default=last * PERIOD_NS) // PERIOD_NS
        self._first = max(oldest, last - KEYFRAMES + 1)
        self._prior = first_prior(len(self._ids))
        self._states = self._prior.at[None].copy()
        self._pairs.clear()

    def _between(self, k: int, count: int) -> Between:
        at_ns = np.arange(k, k + count + 1, dtype=np.int64) * PERIOD_NS
        return self._stepped(at_ns[:-1], at_ns[1:])

    def _stepped(self, from_ns: Times, to_ns: Times) -> Between:
        steps = [self._tracks[robot].steps(from_ns, to_ns) for robot in self._ids]
        elapsed_s = float(to_ns[0] - from_ns[0]) / NS_PER_S if len(from_ns) else 0.0
        return Between(
            moved_m=np.stack([step.moved_m for step in steps], axis=1),
            unknown_m=np.stack([step.unknown_m for step in steps], axis=1),
            length_m=np.stack([step.length_m for step in steps], axis=1),
            is_new_frame=np.stack([step.is_new_frame for step in steps], axis=1),
            elapsed_s=max(1e-3, elapsed_s),
        )

    def _problem(self) -> Problem:
        count = len(self._states)
        raw = self._raw
        t_ns = np.array([s.t_ns for s in raw], np.int64)
        observer = np.array([self._index[s.observer] for s in raw], np.intp)
        target = np.array([self._index[s.target] for s in raw], np.intp)
        keyframe = np.minimum((t_ns + PERIOD_NS // 2) // PERIOD_NS, self._first + count - 1)
        ways, known = np.zeros((2, len(raw), 3)), keyframe >= self._first
        for i, robot in enumerate(self._ids):
            for side, who in enumerate((observer, target)):
                mine = np.flatnonzero(who == i)
                ways[side, mine] = self._tracks[robot].steps(keyframe[mine] * PERIOD_NS, t_ns[mine]).moved_m
                known[mine] &= self._tracks[robot].knows(t_ns[mine])
        deviations = np.array([_deviations(s) for s in raw]).reshape(-1, 3)
        measured = np.array([(s.azimuth_rad, math.pi / 2 - s.polar_rad, 1 / (s.range_m or math.inf)) for s in raw])
        sightings = Sightings(
            keyframe=(keyframe - self._first)[known].astype(np.intp),
            observer=observer[known],
            target=target[known],
            observer_way_m=ways[0, known],
            target_way_m=ways[1, known],
            measured=measured.reshape(-1, 3)[known],
            std=deviations[known],
            reliability=np.array([s.reliability for s in raw])[known],
            fresh=np.array([s.fresh for s in raw])[known],
        )
        return Problem(self._prior, self._between(self._first, count - 1), sightings, self._firsts(sightings))

    def _firsts(self, sightings: Sightings) -> npt.NDArray[np.intp]:
        """Keyframe and robots of what is in the window of each pair's first sighting."""
        for k, i, j in zip(
            *(v.tolist() for v in (sightings.keyframe, sightings.observer, sightings.target)), strict=True
        ):
            self._pairs.setdefault((min(i, j), max(i, j)), k + self._first)
        rows = [(k - self._first, i, j) for (i, j), k in self._pairs.items() if k >= self._first]
        return np.array(rows, np.intp).reshape(-1, 3)

    def _looked_elsewhere(self, problem: Problem, found: Solution) -> Solution:
        """One robot that is not placed is tried at other places each time, so that the time of an update is bounded."""
        told = _relative(found.states[-1], found.covariance)
        agree = supported(found.states, problem.sightings)
        lost = [] if agree[0] else [0]
        lost += [n + 1 for n, is_placed in enumerate(self._placed(told, agree)) if not is_placed and agree[0]]
        if not lost:
            return found
        self._turns += 1
        robot = lost[self._turns % len(lost)]
        guesses = [*other_guesses(robot, found.states, problem.sightings), self._annealed(problem, found.states)]
        tried = [solve(problem, guess, _TRIED_STEPS) for guess in guesses]
        best = min(tried, key=lambda solution: solution.cost, default=found)
        if best.cost < found.cost:
            best = solve(problem, best.states)
        return min(found, best, key=lambda solution: solution.cost)

    def _annealed(self, problem: Problem, states: Array) -> Array:
        """Where all would be if bearings were vaguer: what agrees with most of them, and no longer with the first."""
        for vaguer in _VAGUER:
            sightings = replace(problem.sightings, std=problem.sightings.std * vaguer)
            states = solve(problem._replace(sightings=sightings), states, _TRIED_STEPS).states
        return states

    def _placed(self, told: Relative, agree: list[bool]) -> list[bool]:
        """Of the others; none of them where what we saw, and who saw us, does not agree with where we are."""
        blocks = [told.covariance[4 * n : 4 * n + 3, 4 * n : 4 * n + 3] for n in range(len(told.state))]
        return [agree[0] and agree[n + 1] and is_sure(told.state[n, :3], block) for n, block in enumerate(blocks)]

    # telling --------------------------------------------------------------------------------------------------------

    def _carried(self, now_ns: int, solution: Solution) -> Relative:
        newest_ns = (self._first + len(solution.states) - 1) * PERIOD_NS
        states, covariance = solution.states[-1], solution.covariance
        between = self._stepped(np.array([newest_ns]), np.array([now_ns]))
        states, covariance = _predicted(states, covariance, between)
        return _relative(states, covariance)

    def _told(self, now_ns: int, solution: Solution, problem: Problem) -> TeamState:
        told = self._carried(now_ns, solution)
        placed = self._placed(told, supported(solution.states, problem.sightings))
        members = []
        for n, robot in enumerate(self._ids[1:]):
            i = 4 * n
            block = told.covariance[i : i + 3, i : i + 3]
            of_it = (problem.sightings.observer == n + 1) | (problem.sightings.target == n + 1)
            members.append(
                Member(
                    id=robot,
                    p_own_m=_vector(told.state[n, :3]),
                    covariance_m2=(_vector(block[0]), _vector(block[1]), _vector(block[2])),
                    std_m=largest_std_m(block),
                    heading_rad=math.remainder(float(told.state[n, 3]), math.tau),
                    heading_std_rad=math.sqrt(float(told.covariance[i + 3, i + 3])),
                    placed=placed[n],
                    sightings=int(of_it.sum()),
                )
            )
        return TeamState(
            t_mono_ns=now_ns,
            own_heading_rad=float(solution.states[-1, 0, 3]),
            own_heading_std_rad=math.sqrt(float(solution.covariance[3, 3])),
            members=tuple(members),
            sightings=len(problem.sightings),
        )


def _key(sighting: RawSighting) -> tuple[int, int, int, int]:
    return sighting.observer, sighting.boot, sighting.number, sighting.target


def _deviations(sighting: RawSighting) -> tuple[float, float, float]:
    inverse = math.inf
    if sighting.range_m is not None and math.isfinite(sighting.range_std_m):
        inverse = math.hypot(sighting.range_std_m / sighting.range_m**2, INVERSE_RANGE_STD)
    return (
        math.hypot(sighting.azimuth_std_rad, AZIMUTH_STD_RAD),
        math.hypot(sighting.polar_std_rad, ELEVATION_STD_RAD),
        inverse,
    )


def _predicted(states: Array, covariance: Array, between: Between) -> tuple[Array, Array]:
    after = moved(states[None], between)
    return after[0], step_covariance(covariance, after - states, between)


def _relative(states: Array, covariance: Array) -> Relative:
    """In our own axes: R(-h_0) (p_k - p_0), h_k - h_0."""
    cos, sin = math.cos(states[0, 3]), math.sin(states[0, 3])
    back = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    others = len(states) - 1
    relative, jacobian = np.zeros((others, 4)), np.zeros((4 * others, 4 * len(states)))
    for n in range(others):
        offset_m = back @ (states[n + 1, :3] - states[0, :3])
        relative[n] = (*offset_m, states[n + 1, 3] - states[0, 3])
        row, column = 4 * n, 4 * (n + 1)
        jacobian[row : row + 3, column : column + 3], jacobian[row : row + 3, 0:3] = back, -back
        jacobian[row : row + 3, 3] = (offset_m[1], -offset_m[0], 0.0)
        jacobian[row + 3, column + 3], jacobian[row + 3, 3] = 1.0, -1.0
    return Relative(relative, jacobian @ covariance @ jacobian.T)


def _vector(values: Array) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z
