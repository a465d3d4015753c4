"""`drift`: what errors of the displacement cost (labels table:sim_error_impact, fig:aoa_vs_ATE_error).

As in the paper: ideal paths of 3.14 m with 501 positions, a source 100 m away, and an error that accumulates, scaled
to the wanted ATE (root mean square of the distance between true and estimated position, nothing aligned). Three kinds
of error: a random walk (the paper's), a constant bias of the velocity, and angular drift that rises from nothing to
what the paper says belongs to the ATE, 10 degrees at 0.2 m; that one has a smaller ATE of its own.

Beside the highest point of the profile each trial has the least-squares answer, which needs the truth: how far the peak
moves while phase errors are small against one radian. It is in proportion to the error and knows no wavelength.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt
from numpy.random import SeedSequence

from companion.study.angles import AoaError, aoa_error
from companion.study.figures import draw_lines
from companion.study.paths import circle, climbing_helix, wander
from companion.study.study import Finding, Settings, Study, Summary
from wsr.aoa import Estimator
from wsr.aperture import make_aperture
from wsr.channel import wavelength_m
from wsr.crb.angular_drift import with_angular_drift
from wsr.estimators.bartlett import Bartlett
from wsr.estimators.robust import Robust
from wsr.geometry import direction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]
Path = Literal["3D helix", "2D circle", "3D arbitrary"]
Error = Literal["random walk", "velocity bias", "angular ramp"]

_WAVELENGTH_M = wavelength_m(108)
_LENGTH_M, _POSITIONS, _DISTANCE_M = 3.14, 501, 100.0
_SPEED_M_S = 0.5
_KINDS: tuple[Error, ...] = ("random walk", "velocity bias", "angular ramp")
_DRIFT_DEG_PER_M = 50.0
_ATE_M = (0.025, 0.05, 0.1, 0.15, 0.2)
_TABLE_ATE_M = (0.1, 0.15, 0.2)
_PAPER_DEG = {
    ("3D helix", "azimuth_deg"): (2.5, 3.75, 5.0),
    ("3D helix", "polar_deg"): (7.8, 10.9, 14.0),
    ("2D circle", "azimuth_deg"): (5.7, 8.24, 10.8),
}
_METHODS = (
    "bartlett one-way",
    "bartlett two-way",
    "robust one-way",
    "robust two-way",
    "least squares",
)
_SHOWN = ("bartlett one-way", "bartlett two-way", "robust two-way", "least squares")
_SYMBOL = {"azimuth_deg": "phi", "polar_deg": "theta"}


@dataclass(frozen=True, slots=True)
class DriftCase:
    path: Path
    error: Error
    ate_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DriftRow:
    """One error drawn, seen by every method. Of a path in a plane the polar angle means nothing."""

    path: str
    error: str
    ate_m: float
    own_ate_m: float
    """Differs from `ate_m` for the angular ramp alone."""
    errors: dict[str, AoaError]


def _plan(settings: Settings) -> list[DriftCase]:
    paths: tuple[Path, ...] = ("3D helix", "2D circle", "3D arbitrary")
    return [DriftCase(p, e, a) for p in paths for e in _KINDS for a in _ATE_M for _ in range(settings.trials)]


def _trial(case: DriftCase, seed: SeedSequence) -> DriftRow:
    rng = np.random.default_rng(seed)
    p_m = _path(case.path, rng)
    azimuth = rng.uniform(-math.pi, math.pi)
    polar = math.pi / 2 if case.path == "2D circle" else math.acos(rng.uniform(-0.5, 0.5))
    u = direction(azimuth, polar)
    error_m = _angular_ramp(case, p_m, rng) if case.error == "angular ramp" else _error(case, rng)
    estimated_m = p_m + error_m
    distance_m = np.linalg.norm(p_m[0] + _DISTANCE_M * u - p_m, axis=1)
    t_s = np.linspace(0.0, _LENGTH_M / _SPEED_M_S, _POSITIONS)
    errors = {}
    for word, turns in (("one-way", 1), ("two-way", 2)):
        channel = np.exp(-2j * np.pi * turns * distance_m / _WAVELENGTH_M)
        # Estimators count 4 pi a wavelength; one-way phase is that of a product at twice the wavelength.
        aperture = make_aperture(t_s, estimated_m, channel, 2 * _WAVELENGTH_M / turns)
        estimators: dict[str, Estimator] = {"bartlett": Bartlett(), "robust": Robust()}
        for name, estimator in estimators.items():
            found = estimator.estimate(aperture)[0]
            errors[f"{name} {word}"] = aoa_error(found.azimuth_rad, found.polar_rad, azimuth, polar)
    errors["least squares"] = _least_squares(p_m, estimated_m, azimuth, polar)
    own_ate_m = math.sqrt(float(np.mean(np.sum(error_m**2, axis=1))))
    return DriftRow(
        path=case.path,
        error=case.error,
        ate_m=case.ate_m,
        own_ate_m=own_ate_m,
        errors={name: errors[name] for name in _METHODS},
    )


def _path(path: Path, rng: np.random.Generator) -> Array:
    if path == "3D helix":
        return climbing_helix(_LENGTH_M, _POSITIONS, turns=2.0, pitch=0.3)
    if path == "2D circle":
        return circle(_LENGTH_M, _POSITIONS)
    return wander(rng, _LENGTH_M, _POSITIONS, planar=False)


def _error(case: DriftCase, rng: np.random.Generator) -> Array:
    """(N, 3), zero at the start, with the wanted ATE; in a plane for a path in a plane."""
    if case.error == "random walk":
        error = np.cumsum(rng.normal(size=(_POSITIONS, 3)), axis=0)
        error -= error[0]
    else:
        error = np.linspace(0.0, 1.0, _POSITIONS)[:, None] * rng.normal(size=3)
    if case.path == "2D circle":
        error[:, 2] = 0.0
    return np.asarray(error * (case.ate_m / math.sqrt(float(np.mean(np.sum(error**2, axis=1))))))


def _angular_ramp(case: DriftCase, p_m: Array, rng: np.random.Generator) -> Array:
    """Offsets of azimuth and polar angle about the middle of the path that rise in proportion to time."""
    ramp = np.linspace(0.0, math.radians(_DRIFT_DEG_PER_M * case.ate_m), _POSITIONS)
    signs = rng.choice([-1.0, 1.0], 2)
    middle_m = p_m.mean(axis=0)
    polar = np.zeros(_POSITIONS) if case.path == "2D circle" else signs[1] * ramp
    return np.asarray(with_angular_drift(p_m - middle_m, signs[0] * ramp, polar) + middle_m - p_m)


def _least_squares(p_m: Array, estimated_m: Array, azimuth: float, polar: float) -> AoaError:
    """The direction that best explains the phases of small errors: x . du = -e . u, both about their means."""
    x, error = estimated_m - estimated_m.mean(axis=0), estimated_m - p_m
    by_azimuth = math.sin(polar) * direction(azimuth + math.pi / 2, math.pi / 2)
    by_polar = direction(azimuth, polar + math.pi / 2)
    spatial = float(np.ptp(x[:, 2])) > 0.0
    columns = np.stack([x @ by_azimuth, x @ by_polar] if spatial else [x @ by_azimuth], axis=1)
    wanted = -(error - error.mean(axis=0)) @ direction(azimuth, polar)
    moved = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    return aoa_error(azimuth + float(moved[0]), polar + (float(moved[1]) if spatial else 0.0), azimuth, polar)


def _median(rows: Sequence[DriftRow], path: str, error: str, ate_m: float, *, method: str, angle: str) -> float:
    chosen = [row for row in rows if (row.path, row.error, row.ate_m) == (path, error, ate_m)]
    return float(np.median([getattr(row.errors[method], angle) for row in chosen]))


def _summarise(rows: Sequence[DriftRow]) -> Summary:
    findings = []
    for error in _KINDS:
        for (path, angle), paper in _PAPER_DEG.items():
            for method in _SHOWN:
                for ate_m, value in zip(_TABLE_ATE_M, paper, strict=True):
                    quantity = f"{error}, {path}, {_SYMBOL[angle]}, ATE {ate_m} m: {method}"
                    ours = _median(rows, path, error, ate_m, method=method, angle=angle)
                    findings.append(
                        Finding(
                            quantity=quantity, ours=ours, paper=None if error == "velocity bias" else value, unit="deg"
                        )
                    )
        for method in _SHOWN:
            for ate_m in _TABLE_ATE_M:
                ours = _median(rows, "3D arbitrary", error, ate_m, method=method, angle="great_circle_deg")
                quantity = f"{error}, 3D arbitrary, great circle, ATE {ate_m} m: {method}"
                findings.append(
                    Finding(
                        quantity=quantity,
                        ours=ours,
                        paper="linear in ATE" if error == "random walk" else None,
                        unit="deg",
                    )
                )
    return Summary(findings, [_within(rows), _bias(rows), _ramp(rows), *_NOTES])


def _within(rows: Sequence[DriftRow]) -> str:
    """How many cells of the table each method is within a factor of two of."""
    parts = []
    for method in _METHODS:
        hits = [
            0.5 <= _median(rows, path, "random walk", ate_m, method=method, angle=angle) / value <= 2.0
            for (path, angle), paper in _PAPER_DEG.items()
            for ate_m, value in zip(_TABLE_ATE_M, paper, strict=True)
        ]
        parts.append(f"{method} {sum(hits)} of {len(hits)}")
    return "Cells of Table 1 within a factor of 2: " + ", ".join(parts) + "."


def _bias(rows: Sequence[DriftRow]) -> str:
    chosen = [row for row in rows if row.error == "velocity bias"]
    parts = []
    for method in ("bartlett two-way", "robust two-way"):
        space = [row.errors[method].great_circle_deg for row in chosen if row.path != "2D circle"]
        plane = [row.errors[method].azimuth_deg for row in chosen if row.path == "2D circle"]
        in_space, in_plane = (f"{np.median(e):.2f} (mean {np.mean(e):.2f})" for e in (space, plane))
        parts.append(f"{method} {in_space} and {in_plane} deg")
    return (
        "Under velocity bias, medians over all ATE, great circle on both paths in space and phi on the circle: "
        f"{', '.join(parts)}."
    )


def _ramp(rows: Sequence[DriftRow]) -> str:
    own = [row.own_ate_m for row in rows if row.error == "angular ramp" and row.ate_m == _TABLE_ATE_M[-1]]
    top_deg, ate_m = _DRIFT_DEG_PER_M * _TABLE_ATE_M[-1], _TABLE_ATE_M[-1]
    return (
        f"An angular ramp to {top_deg:g} deg, which the paper has at {ate_m} m, has an ATE of {np.mean(own):.3f} m on "
        "these paths; the table's phi in 3D is half of the ramp."
    )


_NOTES = (
    "Medians over the trials. The table's errors grow in proportion to the ATE, which the highest point of a profile "
    "at 5 GHz does not do beyond 0.1 m: docs/results/studies.md shows what the table must have assumed.",
    "robust takes the root of a product itself, so two-way and one-way phase differ only in the wavelength it is told.",
)


def _draw(rows: Sequence[DriftRow], figure: Figure) -> None:
    panels = figure.subplots(3, 4)
    for row, error in enumerate(_KINDS):
        for column, (path, angle) in enumerate(_PAPER_DEG):
            axes = panels[row, column]
            groups = {m: [_median(rows, path, error, a, method=m, angle=angle) for a in _ATE_M] for m in _SHOWN}
            draw_lines(axes, _ATE_M, groups, "ATE [m]", ylabel=f"median {_SYMBOL[angle]} error [deg]")
            if error != "velocity bias":
                axes.plot(_TABLE_ATE_M, _PAPER_DEG[path, angle], "k*", markersize=10, label="paper, Table 1")
                axes.legend(fontsize=7)
            axes.set_title(f"{path}, {error}", fontsize=9)
        last, angle = panels[row, 3], "great_circle_deg"
        groups = {m: [_median(rows, "3D arbitrary", error, a, method=m, angle=angle) for a in _ATE_M] for m in _SHOWN}
        draw_lines(last, _ATE_M, groups, "ATE [m]", ylabel="median great circle [deg]")
        last.set_title(f"3D arbitrary, {error}", fontsize=9)


STUDY = Study(
    name="drift",
    title="AOA error against the error of the displacement",
    figures=("table:sim_error_impact", "fig:aoa_vs_ATE_error"),
    default_trials=40,
    plan=_plan,
    trial=_trial,
    summarise=_summarise,
    draw=_draw,
    size_in=(16.0, 11.0),
)
