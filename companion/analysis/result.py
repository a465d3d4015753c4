"""What an analysis of recorded runs is asked, and what it answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from companion.analysis.exchanges import PacketTimes
from companion.analysis.runs import Run
from companion.analysis.trajectories import PoseKind
from companion.core.messages import Vector3
from wsr.aoa import AoaEstimate
from wsr.directions import Profile
from wsr.estimators.options import RobustOptions
from wsr.geometry import direction, great_circle, wrap_angle

NO_LEVER: Final[Vector3] = (0.0, 0.0, 0.0)
DEFAULT_LEVERS_M: Final[Mapping[PoseKind, Vector3]] = {
    PoseKind.MOCAP: NO_LEVER,
    PoseKind.T265: NO_LEVER,
    # Of the robot of the WSR data sets: its odometry is that of the wheel base, and motion capture, whose markers are
    # on the antenna, sees that point circle the wheel base at this place; measured by benchmarks/odometry_lever.py.
    PoseKind.ODOM: (0.044, 0.160, 0.0),
}
"""The antenna seen from the tracked point: forward, left, up."""


@dataclass(frozen=True, slots=True)
class Direction:
    """A direction in ENU: azimuth counter-clockwise from East, polar angle from Up."""

    azimuth_rad: float
    polar_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkResult:
    """What one transmitter gave. Without an estimate, `problem` says why."""

    name: str
    mac: str | None = None
    packets: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    estimate: AoaEstimate | None = None
    profile: Profile | None = None
    truth: Direction | None = None
    """From the estimate's own reference point, where that is known in the frame of the true positions."""
    truth_problem: str | None = None
    """Why there is no truth beside an estimate."""
    problem: str | None = None
    notes: tuple[str, ...] = ()
    """What to know about its log and its estimate, where there is one."""
    times: PacketTimes | None = None
    trajectory: Path | None = None
    """Of the transmitter, where it moves."""

    @property
    def used(self) -> int:
        return 0 if self.estimate is None else self.estimate.packets

    @property
    def azimuth_error_rad(self) -> float | None:
        """Estimate less truth, in [-pi, pi)."""
        if self.estimate is None or self.truth is None or not self.estimate.azimuth_observable:
            return None
        return float(wrap_angle(self.estimate.azimuth_rad - self.truth.azimuth_rad))

    @property
    def great_circle_error_rad(self) -> float | None:
        """Angle between estimate and truth; None where the polar angle is not observable."""
        if self.azimuth_error_rad is None or self.estimate is None or not self.estimate.polar_observable:
            return None
        assert self.truth is not None
        u = direction(self.estimate.azimuth_rad, self.estimate.polar_rad)
        return float(great_circle(u, direction(self.truth.azimuth_rad, self.truth.polar_rad)))


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """What one run gave. Without links either files are `missing` or there is a `failure`."""

    run: Run
    kind: PoseKind | None
    links: tuple[LinkResult, ...] = ()
    missing: tuple[str, ...] = ()
    """Files that are not there, and so the links that need them are not either."""
    problems: tuple[str, ...] = ()
    """What is wrong with files that are used all the same."""
    failure: str | None = None
    """Why no link could be tried, though all files are there."""
    truth_problem: str | None = None
    """Why no link has a truth."""
    lever_m: Vector3 = NO_LEVER
    """Of the antenna, as used."""
    trajectory: Path | None = None
    """The file that was used, and `layout`, what it was taken for."""
    layout: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What the user decided. Each None means: as the recording says."""

    kind: PoseKind | None = None
    channel: int | None = None
    macs: Mapping[str, str] = field(default_factory=dict)
    """MAC by transmitter name; only these transmitters, unless it is empty."""
    lever_m: Vector3 | None = None
    time_offset_s: float = 0.0
    """Added to the trajectory's stamps, so that they are on the clock of the receiving robot's host."""
    tx_time_offsets_s: Mapping[str, float] = field(default_factory=dict)
    """The same of each transmitter's trajectory, to its own host's clock."""
    tx_levers_m: Mapping[str, Vector3] = field(default_factory=dict)
    """Of each moving transmitter's antenna, as `lever_m`."""
    estimator: str = "robust"
    """One of `wsr.estimators.ESTIMATORS`."""
    robust: RobustOptions = field(default_factory=RobustOptions)
    """Switches of `robust`, where that is the estimator."""
    as_sent: bool = True
    """The transmitter's channels as its datagrams would have brought them; else as its card reported them."""
