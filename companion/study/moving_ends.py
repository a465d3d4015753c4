"""`moving-ends`: both robots move (section sec:results_movingEnds; labels fig:Relative_Traj_comparison_3D and _2D).

The paper's two scenarios: robot i flies a helix at 0.5 m/s, or drives straight at 0.1 m/s, while robot j drives
straight with a speed that varies up to 0.1 m/s, 10 m away. One recording of each is estimated in several ways: with the
other's displacement and without; with it in its own rotated axes, turned back or not; and joined by the exchange or by
wall clocks that disagree. The first recording of each scenario is drawn as in the paper, by displacements and profile.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import SeedSequence

from companion.sim.scenario import RadioScenario
from companion.sim.trajectory import Trajectory
from companion.study.angles import AoaError, aoa_error, share_below
from companion.study.figures import STYLES, draw_cdf
from companion.study.link import CLOCK_OFFSET_S, Heard, hear, room, scenario, standing, trajectory
from companion.study.paths import Array, climbing_helix, line
from companion.study.study import Finding, Settings, Study, Summary
from wsr.aoa import Estimator
from wsr.estimators.bartlett import Bartlett
from wsr.estimators.robust import Robust
from wsr.geometry import angles, direction, rotation_z

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HELIX, _LINE = "helix", "line"
_DISTANCE_M, _MAX_SPEED_M_S = 10.0, 0.1
_START_S, _BEFORE_S = 8.0, 7.0
_CLOCK_ERRORS_S = (0.1, 1.0, 5.0)
_COMPASS_RAD = math.radians(5.0)
_SPEED_M_S = {_HELIX: 0.5, _LINE: 0.1}
_RATE_HZ = {_HELIX: 80.0, _LINE: 40.0}
_PROFILE_STEP = 3
_LIMIT_DEG = 10.0
_CORRECTED = "corrected"
_STANDING = "j stands"
_VARIANTS = (
    _STANDING,
    _CORRECTED,
    "not corrected",
    "own axes, turned to North",
    "own axes, North known to 5 deg",
    "own axes, not turned",
    "clocks 38 s apart, joined by the exchange",
    *(f"clocks {error:g} s apart, joined by time" for error in _CLOCK_ERRORS_S),
)


@dataclass(frozen=True, slots=True)
class MovingCase:
    scenario: str
    is_sample: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingSample:
    """One recording as the paper shows it: displacements (K, 3) in metres of both ends and of one against the other, of
    every fifth packet; the corrected profile of `bartlett`, rows of polar angle, the highest of 3 by 3 degrees; truth.
    """

    own_m: list[list[float]]
    other_m: list[list[float]]
    relative_m: list[list[float]]
    profile: list[list[float]]
    azimuth_deg: float
    polar_deg: float


@dataclass(frozen=True, slots=True)
class MovingRow:
    """Errors by "estimator, variant" of one recording."""

    scenario: str
    errors: dict[str, AoaError]
    sample: MovingSample | None


def _plan(settings: Settings) -> list[MovingCase]:
    return [MovingCase(name, i == 0) for name in (_HELIX, _LINE) for i in range(settings.trials)]


def _trial(case: MovingCase, seed: SeedSequence) -> MovingRow:
    rng = np.random.default_rng(seed)
    own = _own_path(case.scenario, rng)
    start_m = own.p_enu_m.mean(axis=0) + _DISTANCE_M * direction(rng.uniform(-math.pi, math.pi), math.radians(91.0))
    other = _drive(start_m, rng, own.t_s[-1] + _BEFORE_S)
    world = scenario(
        seed, room(rng, [own.p_enu_m[0], start_m], RadioScenario(exchange_rate_hz=_RATE_HZ[case.scenario]))
    )
    heard = hear(world, own, other)
    still = standing(start_m, own.t_s[0], own.t_s[-1])
    errors = _errors(_STANDING, hear(world, own, still), own, still, believed_m=None)
    for variant, believed_m in _believed(heard, other, rng).items():
        errors |= _errors(variant, heard, own, other, believed_m=believed_m)
    return MovingRow(case.scenario, errors, _sample(heard, own, other) if case.is_sample else None)


def _sample(heard: Heard, own: Trajectory, other: Trajectory) -> MovingSample:
    own_m, other_m = own.at(heard.t_s)[0], other.at(heard.t_s)[0]
    profile = Bartlett().estimate(heard.aperture(own_m, other_m))[1]
    azimuth, polar = (math.degrees(float(a)) for a in angles(other_m[0] - own_m[0]))
    i_m, j_m, relative_m = (np.round(p[::5] - p[0], 4).tolist() for p in (own_m, other_m, own_m - other_m))
    rows, columns = (size // _PROFILE_STEP for size in profile.power.shape)
    blocks = profile.power.astype(np.float64).reshape(rows, _PROFILE_STEP, columns, _PROFILE_STEP)
    power = np.round(blocks.max(axis=(1, 3)), 3).tolist()
    return MovingSample(
        own_m=i_m, other_m=j_m, relative_m=relative_m, profile=power, azimuth_deg=azimuth, polar_deg=polar
    )


def _own_path(name: str, rng: np.random.Generator) -> Trajectory:
    points = climbing_helix(2.8, 400, turns=1.0, pitch=0.5) if name == _HELIX else line(1.2, 200)
    turned = (points - points.mean(axis=0)) @ rotation_z(rng.uniform(-math.pi, math.pi)).T
    return trajectory(turned + np.array([0.0, 0.0, 1.5]), _SPEED_M_S[name], _START_S)


def _drive(start_m: Array, rng: np.random.Generator, end_s: float) -> Trajectory:
    """Straight, with a speed between 0 and the greatest; samples since long before the recording."""
    t_s = np.arange(_START_S - _BEFORE_S, end_s, 0.02)
    period_s, phase = rng.uniform(4.0, 10.0), rng.uniform(-math.pi, math.pi)
    speed = _MAX_SPEED_M_S * (1 + np.sin(2 * math.pi * t_s / period_s + phase)) / 2
    way_m = np.concatenate([[0.0], np.cumsum(speed[:-1] * np.diff(t_s))])
    heading = direction(rng.uniform(-math.pi, math.pi), math.pi / 2)
    way_m -= np.interp(_START_S, t_s, way_m)
    return Trajectory(t_s, start_m + way_m[:, None] * heading, np.zeros(t_s.size))


def _believed(heard: Heard, other: Trajectory, rng: np.random.Generator) -> dict[str, Array | None]:
    """Positions (K, 3) of the other robot that the receiver computes with; None: it takes it for standing."""
    true_m = other.at(heard.t_s)[0]
    yaw, compass = rng.uniform(-math.pi, math.pi), _COMPASS_RAD * rng.choice([-1.0, 1.0])
    origin_m = rng.normal(size=3)
    own_axes_m = (true_m - origin_m) @ rotation_z(yaw).T
    # The other's poses carry its clock, and so does its record of each exchange: interpolated there, joined by counter.
    by_exchange_m = Trajectory(other.t_s + CLOCK_OFFSET_S, other.p_enu_m, other.yaw_rad).at(heard.other_t_s)[0]
    by_time = {f"clocks {error:g} s apart, joined by time": other.at(heard.t_s - error)[0] for error in _CLOCK_ERRORS_S}
    return {
        _CORRECTED: true_m,
        "not corrected": None,
        "own axes, turned to North": own_axes_m @ rotation_z(-yaw).T,
        "own axes, North known to 5 deg": own_axes_m @ rotation_z(-yaw + compass).T,
        "own axes, not turned": own_axes_m,
        "clocks 38 s apart, joined by the exchange": by_exchange_m,
        **by_time,
    }


def _errors(
    variant: str, heard: Heard, own: Trajectory, other: Trajectory, *, believed_m: Array | None
) -> dict[str, AoaError]:
    aperture = heard.aperture(own.at(heard.t_s)[0], believed_m)
    estimators: dict[str, Estimator] = {"bartlett": Bartlett(), "robust": Robust()}
    errors = {}
    for name, estimator in estimators.items():
        found = estimator.estimate(aperture)[0]
        at = other.at(np.array([found.reference_t_s]))[0][0]
        truth = angles(at - np.array(found.reference_p_m))
        errors[f"{name}, {variant}"] = aoa_error(found.azimuth_rad, found.polar_rad, float(truth[0]), float(truth[1]))
    return errors


def _values(rows: Sequence[MovingRow], scenario_name: str, key: str, measure: str) -> list[float]:
    return [getattr(row.errors[key], measure) for row in rows if row.scenario == scenario_name]


def _summarise(rows: Sequence[MovingRow]) -> Summary:
    findings = []
    for name, measure, word in ((_HELIX, "great_circle_deg", "great circle"), (_LINE, "azimuth_deg", "azimuth")):
        for estimator in ("bartlett", "robust"):
            for variant in _VARIANTS:
                values = _values(rows, name, f"{estimator}, {variant}", measure)
                paper = _PAPER.get((name, estimator, variant))
                head = f"i on a {name}, {estimator}, {variant}"
                findings.append(
                    Finding(
                        quantity=f"{head}: median {word} error", ours=float(np.median(values)), paper=paper, unit="deg"
                    )
                )
                findings.append(
                    Finding(
                        quantity=f"{head}: below 10 deg", ours=share_below(values, _LIMIT_DEG), paper=None, unit="%"
                    )
                )
    return Summary(
        findings,
        [
            "The paper shows one profile a scenario and gives no aggregate. Of a level path only the azimuth is asked.",
            "The straight path of i alone sees a cone, so left or right is a throw of a coin, and only the share below "
            "10 deg means something; the path of j bends the relative one, which frees the azimuth.",
        ],
    )


_PAPER = {
    (_HELIX, "bartlett", _CORRECTED): "similar to j standing",
    (_LINE, "bartlett", _CORRECTED): "0 (one sample)",
}


def _draw(rows: Sequence[MovingRow], figure: Figure) -> None:
    grid = figure.add_gridspec(2, 4)
    for row, (name, measure) in enumerate(((_HELIX, "great_circle_deg"), (_LINE, "azimuth_deg"))):
        sample = next((r.sample for r in rows if r.scenario == name and r.sample is not None), None)
        if sample is not None:
            projection = "3d" if name == _HELIX else None
            _draw_paths(figure.add_subplot(grid[row, 0], projection=projection), sample, is_level=name == _LINE)
            _draw_profile(figure.add_subplot(grid[row, 1]), sample)
        for column, estimator in enumerate(("bartlett", "robust"), start=2):
            groups = {v: _values(rows, name, f"{estimator}, {v}", measure) for v in _VARIANTS}
            label = f"{measure.removesuffix('_deg').replace('_', ' ')} error [deg]"
            panel = figure.add_subplot(grid[row, column])
            draw_cdf(panel, groups, label, (0, 60))
            panel.set_title(f"i on a {name}, {estimator}", fontsize=9)


def _draw_paths(axes: Any, sample: MovingSample, is_level: bool) -> None:
    """Displacement of i, of j, and of i against j; from above where it is level."""
    named = (("i", sample.own_m), ("j", sample.other_m), ("i against j", sample.relative_m))
    for (label, points), style in zip(named, STYLES, strict=False):
        axes.plot(*np.array(points).T[: 2 if is_level else 3], linestyle=style, label=label)
    axes.set(xlabel="East [m]", ylabel="North [m]")
    if is_level:
        axes.axis("equal")
    else:
        axes.set_zlabel("up [m]")
    axes.set_title("displacement, first recording", fontsize=9)
    axes.legend(fontsize=7)


def _draw_profile(axes: Axes, sample: MovingSample) -> None:
    axes.imshow(np.array(sample.profile), extent=(-180, 180, 180, 0), aspect="auto", cmap="viridis")
    axes.plot(sample.azimuth_deg, sample.polar_deg, "rx", markersize=9, label="truth")
    axes.set(xlabel="azimuth [deg]", ylabel="polar angle [deg]")
    axes.set_title("profile of bartlett, corrected", fontsize=9)
    axes.legend(fontsize=7)


STUDY = Study(
    name="moving-ends",
    title="AOA error with both robots moving",
    figures=("fig:Relative_Traj_comparison_3D", "fig:Relative_Traj_comparison_2D"),
    default_trials=30,
    plan=_plan,
    trial=_trial,
    summarise=_summarise,
    draw=_draw,
    size_in=(20.0, 9.0),
)
