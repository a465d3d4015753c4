"""`python -m benchmarks.odometry_lever DIR`: where the antenna is from the point that wheel odometry tracks.

Motion capture has its markers on the antenna, odometry is of the wheel base. With the pose p_k, R_k of odometry, turned
back by its own start yaw as everywhere, and the place m_k that motion capture sees at the same time,

    m_k = t + p_k + R_k l,    l the antenna seen from the wheel base, t a shift,

is least squares in t and l. A start that was not quite along East turns l by as much, and cannot be told from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from companion.analysis.result import DEFAULT_LEVERS_M
from companion.analysis.runs import Run, find_runs
from companion.analysis.trajectories import PoseKind, RecordedTrajectory, read_trajectory
from companion.errors import CompanionError
from wsr.displacement import interpolate
from wsr.geometry import yaw_of

_MAX_GAP_S = 0.1


@dataclass(frozen=True, slots=True)
class Lever:
    """Of one run, with the root mean square of what it leaves."""

    forward_m: float
    left_m: float
    residual_m: float


def lever_of_run(run: Run) -> Lever:
    """Raises CompanionError where the run has not both trajectories, with attitudes."""
    odometry, mocap = _read(run, PoseKind.ODOM), _read(run, PoseKind.MOCAP)
    assert odometry.q_wxyz is not None  # odometry without is refused when it is read
    seen, valid = interpolate(odometry.t_s, mocap.t_s, mocap.p_enu_m, _MAX_GAP_S)
    yaw = np.array([float(yaw_of(q)) for q in odometry.q_wxyz[valid]])
    c, s = np.cos(yaw), np.sin(yaw)
    turned = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)
    apart = (seen - odometry.p_enu_m)[valid, :2]
    a, b = _centred(turned), _centred(apart)
    lever, *_ = np.linalg.lstsq(a, b, rcond=None)
    left_over = (b - a @ lever).reshape(-1, 2)
    return Lever(float(lever[0]), float(lever[1]), float(np.sqrt((left_over**2).sum(axis=1).mean())))


def _centred(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Without the mean over packets, which takes out the shift; two rows for each packet."""
    less = values - values.mean(axis=0)
    return np.asarray(less.reshape(-1, *values.shape[2:]))


def _read(run: Run, kind: PoseKind) -> RecordedTrajectory:
    if kind not in run.trajectories:
        raise CompanionError(f"{run.folder}: no {kind} trajectory of {run.stamp}")
    return read_trajectory(run.trajectories[kind], kind)


@click.command()
@click.argument("directory", metavar="DIR", type=click.Path(path_type=Path, exists=True))
def main(directory: Path) -> None:
    """Forward and left of the antenna in each run, and the median of all."""
    levers = []
    for run in find_runs(directory):
        try:
            one = lever_of_run(run)
        except CompanionError as error:
            click.echo(f"left out: {error}")
            continue
        levers.append((one.forward_m, one.left_m))
        place = f"{one.forward_m:+.3f} m forward, {one.left_m:+.3f} m left"
        click.echo(f"{run.title}: {place}; leaves {1e3 * one.residual_m:.1f} mm")
    if levers:
        (forward, left), (low_f, low_l), (high_f, high_l) = (np.percentile(levers, q, axis=0) for q in (50, 0, 100))
        click.echo(
            f"{len(levers)} runs: median {forward:+.3f} m forward ({low_f:+.3f} to {high_f:+.3f}), {left:+.3f} m left "
            f"({low_l:+.3f} to {high_l:+.3f}); in use {DEFAULT_LEVERS_M[PoseKind.ODOM]}"
        )


if __name__ == "__main__":
    main()
