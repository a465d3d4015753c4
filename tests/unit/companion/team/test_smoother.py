"""The smoother's linear algebra: no step raises the cost, what leaves the window is not lost and not doubled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from companion.team.factors import Sightings
from companion.team.smoother import Between, Problem, first_prior, marginalised, moved, solve
from tests.unit.companion.team.test_factors import sightings


def between(rng: np.random.Generator, keyframes: int, robots: int) -> Between:
    ways_m = rng.normal(0.0, 0.7, (keyframes - 1, robots, 3))
    nothing = np.zeros((keyframes - 1, robots))
    return Between(
        moved_m=ways_m,
        unknown_m=nothing,
        length_m=np.linalg.norm(ways_m, axis=2),
        is_new_frame=nothing > 0,
        elapsed_s=2.0,
    )


def window(keyframes: int = 4, robots: int = 3, seed: int = 1) -> tuple[Problem, np.ndarray]:
    """Exact sightings of a path that the displacements tell exactly."""
    rng = np.random.default_rng(seed)
    ways = between(rng, keyframes, robots)
    states = np.zeros((keyframes, robots, 4))
    states[0, 1:, :3] = rng.normal(0.0, 5.0, (robots - 1, 3))
    for k in range(keyframes - 1):
        step = Between(*(part[k : k + 1] for part in ways[:4]), 2.0)  # type: ignore[arg-type,call-arg]
        states[k + 1] = moved(states[k : k + 1], step)[0]
    return Problem(first_prior(robots), ways, sightings(states, rng, 60), np.zeros((0, 3), np.intp)), states


def none_of(seen: Sightings) -> Sightings:
    return Sightings(**{name: getattr(seen, name)[:0] for name in Sightings.__slots__})


def test_from_a_guess_that_is_off_the_truth_is_found() -> None:
    problem, truth = window()
    guess = truth.copy()
    guess[:, 1:, :3] *= 1.3
    guess[:, 2, 3] += 0.1
    found = solve(problem, guess, 30)
    offset = (found.states - truth)[-1, 1:, :3]
    assert np.abs(offset).max() < 0.8  # the prior pulls a little
    assert found.cost <= solve(problem, guess, 1).cost


def test_what_leaves_the_window_says_to_the_next_what_it_said_before() -> None:
    """At the same states, where all is linear: covariance and cost's minimum do not move."""
    problem, truth = window()
    whole = solve(problem, truth, 40)
    prior = marginalised(problem, whole.states)
    late = problem.sightings.keyframe > 0
    seen = Sightings(**{name: getattr(problem.sightings, name)[late] for name in Sightings.__slots__})
    shifted = replace(seen, keyframe=seen.keyframe - 1)
    ways = Between(*(part[1:] for part in problem.between[:4]), 2.0)  # type: ignore[arg-type,call-arg]
    rest = solve(Problem(prior, ways, shifted, problem.firsts), whole.states[1:], 40)
    np.testing.assert_allclose(rest.covariance, whole.covariance, rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(rest.states, whole.states[1:], atol=0.02)


def test_without_sightings_the_uncertainty_only_grows() -> None:
    problem, truth = window()
    blind = problem._replace(sightings=none_of(problem.sightings))
    found = solve(blind, truth)
    short = solve(blind._replace(between=Between(*(p[:1] for p in blind.between[:4]), 2.0)), truth[:2])  # type: ignore[arg-type,call-arg]
    assert (np.diag(found.covariance) > np.diag(short.covariance)).all()
    assert (np.diag(found.covariance) > 0).all()
