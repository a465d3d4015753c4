"""The paths and headings of all robots over the last minute, from everybody's sightings and displacements.

A fixed-lag smoother in information form: one keyframe every two seconds with place and heading of each robot; each
robot's own displacement ties its keyframes together, sightings tie robots. Gauss-Newton with damping solves the whole
window anew each time, so that a range that only later motion tells is not linearised where it was guessed; what leaves
the window becomes the prior of its oldest keyframe (Schur complement). Equations: docs/team.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_solve_banded, cholesky_banded

from companion.team.factors import Sightings, look

Array = npt.NDArray[np.float64]

HEADING_STD_RAD: Final = math.radians(7.0)
"""Every robot's axes point East and North, but for this."""
HEADING_WALK_RAD_SQRT_S: Final = math.radians(0.3)
_DRIFT: Final = 0.03
_DRIFT_ALIKE_M: Final = 5.0
_WALK_M_SQRT_S: Final = 0.02
"""Of a robot's own displacement, as the tracker has it (docs/guidance.md)."""
_AWAY_STD_M: Final = (20.0, 20.0, 4.0)
"""Before anything is seen of a robot."""
_PINNED_STD_M: Final = 0.01
"""Our own first place is the origin."""
_MEDIAN_RANGE_M, _LOG_RANGE_STD = 10.0, 1.0
"""Of a pair when it is first seen: half of all are nearer, and two thirds within a factor of e."""
_STEPS: Final = 12
_SETTLED: Final = 1e-3
_STATE: Final = 4


class Between(NamedTuple):
    """From each of K keyframes to the next, of N robots: displacements (K, N, 3) in their own axes, deviations (K, N)
    of what those leave unknown, lengths (K, N) of path, whether its frame is another one (K, N), and the time."""

    moved_m: Array
    unknown_m: Array
    length_m: Array
    is_new_frame: npt.NDArray[np.bool_]
    elapsed_s: float

    def first(self) -> Between:
        return Between(
            moved_m=self.moved_m[:1],
            unknown_m=self.unknown_m[:1],
            length_m=self.length_m[:1],
            is_new_frame=self.is_new_frame[:1],
            elapsed_s=self.elapsed_s,
        )


@dataclass(slots=True)
class WindowPrior:
    """On the oldest keyframe: 0.5 d'Ld + g'd with d = state - `at`."""

    at: Array
    information: Array
    gradient: Array


class Problem(NamedTuple):
    """All that one window says."""

    prior: WindowPrior
    between: Between
    sightings: Sightings
    firsts: npt.NDArray[np.intp]
    """(F, 3): keyframe, observer and target of what was seen for the first time."""


class Solution(NamedTuple):
    states: Array
    """(K, N, 4)"""
    covariance: Array
    """(4 N, 4 N) of the newest keyframe."""
    cost: float


def first_prior(robots: int) -> WindowPrior:
    """Before anything is known; robot 0 is this one."""
    std = np.tile([*_AWAY_STD_M, HEADING_STD_RAD], (robots, 1))
    std[0, :3] = _PINNED_STD_M
    return WindowPrior(np.zeros((robots, _STATE)), np.diag(1 / std.ravel() ** 2), np.zeros(robots * _STATE))


def moved(states: Array, between: Between) -> Array:
    """States (K, N, 4) one keyframe later each, by the robots' own displacements."""
    after = states.copy()
    cos, sin = np.cos(states[..., 3]), np.sin(states[..., 3])
    x, y, z = np.moveaxis(between.moved_m, -1, 0)
    after[..., :3] += np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=-1)
    return after


def solve(problem: Problem, states: Array, max_steps: int = _STEPS) -> Solution:
    """From a guess (K, N, 4). Levenberg and Marquardt's damping: no step raises the cost."""
    damping, cost = 1e-4, _cost(problem, states)
    for _ in range(max_steps):
        hessian, gradient = _normal(problem, states)
        for _ in range(6):
            step = _newton_step(hessian, gradient, damping)
            moved_to = states + step.reshape(states.shape)
            new_cost = _cost(problem, moved_to)
            if new_cost <= cost:
                break
            damping *= 10.0
        else:
            break
        gain, states, cost, damping = cost - new_cost, moved_to, new_cost, max(damping / 10.0, 1e-9)
        if gain < _SETTLED:
            break
    hessian, _ = _normal(problem, states)
    return Solution(states, _newest_covariance(hessian), cost)


def marginalised(problem: Problem, states: Array) -> WindowPrior:
    """What the oldest keyframe of a solved window says of the next one: its Schur complement."""
    size = states.shape[1] * _STATE
    first = problem.sightings.keyframe == 0
    alone = Problem(problem.prior, problem.between.first(), _chosen(problem.sightings, first), problem.firsts)
    alone = alone._replace(firsts=problem.firsts[problem.firsts[:, 0] == 0])
    hessian, gradient = _normal(alone, states[:2])
    blocks = _dense(hessian)
    a, b, c = blocks[:size, :size], blocks[:size, size:], blocks[size:, size:]
    solved = np.linalg.solve(a, np.column_stack([b, gradient[:size]]))
    information = c - b.T @ solved[:, :-1]
    return WindowPrior(states[1].copy(), 0.5 * (information + information.T), gradient[size:] - b.T @ solved[:, -1])


def step_covariance(covariance: Array, step: Array, between: Between) -> Array:
    """Of the states one step (1, N, 4) later."""
    (forward,) = _step_jacobian(step)
    return np.asarray(forward @ covariance @ forward.T + np.diag(1 / _step_information(between).ravel()))


class _Hessian(NamedTuple):
    """Block tridiagonal: `diagonal` (K, S, S) and `beside` (K - 1, S, S), rows of k by columns of k + 1."""

    diagonal: Array
    beside: Array


def _cost(problem: Problem, states: Array) -> float:
    off = (states[0] - problem.prior.at).ravel()
    cost = 0.5 * off @ problem.prior.information @ off + problem.prior.gradient @ off
    if len(states) > 1:
        off_step = states[1:] - moved(states[:-1], problem.between)
        cost += 0.5 * float((_step_information(problem.between) * off_step**2).sum())
    for residual, _ in _first_ranges(problem.firsts, states):
        cost += 0.5 * residual**2
    if len(problem.sightings):
        cost += look(states, problem.sightings).cost
    return float(cost)


def _normal(problem: Problem, states: Array) -> tuple[_Hessian, Array]:
    keyframes, robots, _ = states.shape
    size = robots * _STATE
    diagonal, beside = np.zeros((keyframes, size, size)), np.zeros((keyframes - 1, size, size))
    gradient = np.zeros((keyframes, size))
    diagonal[0] = problem.prior.information
    gradient[0] = problem.prior.information @ (states[0] - problem.prior.at).ravel() + problem.prior.gradient
    if keyframes > 1:
        information = _step_information(problem.between).reshape(keyframes - 1, size)
        foreseen = moved(states[:-1], problem.between)
        residual = (states[1:] - foreseen).reshape(keyframes - 1, size)
        forward = _step_jacobian(foreseen - states[:-1])
        own = np.arange(size)
        diagonal[1:, own, own] += information
        backward = forward.transpose(0, 2, 1) * information[:, None, :]
        diagonal[:-1] += backward @ forward
        beside -= backward
        gradient[1:] += information * residual
        gradient[:-1] -= (backward @ residual[:, :, None])[:, :, 0]
    for (k, i, j), (off, jacobian) in zip(problem.firsts, _first_ranges(problem.firsts, states), strict=True):
        at = np.r_[i * _STATE : i * _STATE + 3, j * _STATE : j * _STATE + 3]
        diagonal[k][np.ix_(at, at)] += np.outer(jacobian, jacobian)
        gradient[k][at] += jacobian * off
    if len(problem.sightings):
        _add_sightings(problem.sightings, states, diagonal, gradient)
    return _Hessian(diagonal, beside), gradient.ravel()


def _add_sightings(sightings: Sightings, states: Array, diagonal: Array, gradient: Array) -> None:
    seen = look(states, sightings)
    weighed = seen.jacobian * seen.information[:, :, None]
    squares = np.einsum("mri,mrj->mij", seen.jacobian, weighed)
    pulls = np.einsum("mri,mr->mi", weighed, seen.residual)
    offsets = np.arange(_STATE)
    at = np.concatenate(
        [sightings.observer[:, None] * _STATE + offsets, sightings.target[:, None] * _STATE + offsets], axis=1
    )
    np.add.at(diagonal, (sightings.keyframe[:, None, None], at[:, :, None], at[:, None, :]), squares)
    np.add.at(gradient, (sightings.keyframe[:, None], at), pulls)


def _step_information(between: Between) -> Array:
    """(K, N, 4) of what each robot's displacement leaves open."""
    walked = _DRIFT**2 * _DRIFT_ALIKE_M * between.length_m + _WALK_M_SQRT_S**2 * between.elapsed_s
    place = 1 / (walked + between.unknown_m**2)
    turned = HEADING_WALK_RAD_SQRT_S**2 * between.elapsed_s
    heading = 1 / np.where(between.is_new_frame, turned + HEADING_STD_RAD**2, turned)
    return np.stack([place, place, place, heading], axis=-1)


def _step_jacobian(step: Array) -> Array:
    """(K, 4 N, 4 N) of the later state by the earlier, where displacements are `step` (K, N, 4) in common axes."""
    keyframes, robots, _ = step.shape
    jacobian = np.tile(np.eye(robots * _STATE), (keyframes, 1, 1))
    first = np.arange(0, robots * _STATE, _STATE)
    jacobian[:, first, first + 3] = -step[..., 1]
    jacobian[:, first + 1, first + 3] = step[..., 0]
    return jacobian


def _first_ranges(firsts: npt.NDArray[np.intp], states: Array) -> list[tuple[float, Array]]:
    """Residual and Jacobian (6,) by both places, of the logarithm of each first range."""
    found = []
    for k, i, j in firsts:
        v = states[k, j, :3] - states[k, i, :3]
        range_m = max(float(np.linalg.norm(v)), 0.3)
        by_v = v / (range_m**2 * _LOG_RANGE_STD)
        residual = math.log(range_m / _MEDIAN_RANGE_M) / _LOG_RANGE_STD
        found.append((residual, np.concatenate([-by_v, by_v])))
    return found


def _banded(hessian: _Hessian) -> Array:
    """Upper form for scipy: row u + r - c holds entry (r, c)."""
    keyframes, size, _ = hessian.diagonal.shape
    upper = 2 * size - 1
    band = np.zeros((upper + 1, keyframes * size))
    rows, columns = np.indices((size, size))
    inside = rows <= columns
    r, c = rows[inside], columns[inside]
    base = np.arange(keyframes)[:, None] * size
    band[upper + r - c, base + c] = hessian.diagonal[:, r, c]
    if keyframes > 1:
        r, c = rows.ravel(), columns.ravel()
        band[upper + r - c - size, base[1:] + c] = hessian.beside[:, r, c]
    return band


def _newton_step(hessian: _Hessian, gradient: Array, damping: float) -> Array:
    band = _banded(hessian)
    band[-1] *= 1 + damping
    return np.asarray(cho_solve_banded((cholesky_banded(band), False), -gradient))


def _newest_covariance(hessian: _Hessian) -> Array:
    size = hessian.diagonal.shape[1]
    band = _banded(hessian)
    unit = np.zeros((band.shape[1], size))
    unit[-size:] = np.eye(size)
    return np.asarray(cho_solve_banded((cholesky_banded(band), False), unit)[-size:])


def _dense(hessian: _Hessian) -> Array:
    """Of two keyframes."""
    (a, c), (b,) = hessian.diagonal, hessian.beside
    return np.block([[a, b], [b.T, c]])


def _chosen(sightings: Sightings, which: npt.NDArray[np.bool_]) -> Sightings:
    return Sightings(**{name: getattr(sightings, name)[which] for name in Sightings.__slots__})
