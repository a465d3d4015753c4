"""`geometry`: AOA errors of straight, plane and spatial paths (labels fig:CDF_phi_theta, fig:CRB_vs_AOA_error).

As in the paper: true displacement, a source 10 m away at a polar angle of 91 degrees in line of sight, 2.8 m of path,
about 400 packets, the highest point of `bartlett`, and no refusal for lines. The radio has the noise, turnaround
jitter and reflections of the simulator's hall.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.random import SeedSequence

from companion.sim.scenario import RadioScenario
from companion.study.angles import AoaError, aoa_error, share_below
from companion.study.figures import MARKERS, draw_cdf
from companion.study.link import hear, room, scenario, standing, trajectory
from companion.study.paths import Array, line, wander
from companion.study.study import Finding, Settings, Study, Summary
from wsr.crb.informativeness import informativeness
from wsr.estimators.bartlett import Bartlett
from wsr.geometry import angles, direction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LENGTH_M, _SPEED_M_S, _DISTANCE_M = 2.8, 0.5, 10.0
_POLAR_RAD = math.radians(91.0)
_RADIO = RadioScenario(exchange_rate_hz=80.0)
_POINTS = 400
_PAPER_SHARE = {"2D line": 7.0, "2D curve": 50.0, "3D": 95.0}
_FLYING_M, _DRIVING_M = 1.5, 0.5
_LIMIT_DEG = 10.0
_MIN_EXTENT_SHARE = 0.15
"""Of the length: a path flatter than this in some direction is no motion in 3D, and is drawn anew."""


@dataclass(frozen=True, slots=True)
class GeometryTrial:
    geometry: str


@dataclass(frozen=True, slots=True)
class GeometryRow:
    """One estimate. `crb_deg` is the great-circle bound in the true direction at the noise of its phases."""

    geometry: str
    error: AoaError
    crb_deg: float
    packets: int


def _plan(settings: Settings) -> list[GeometryTrial]:
    return [GeometryTrial(geometry) for geometry in _PAPER_SHARE for _ in range(settings.trials)]


def _trial(case: GeometryTrial, seed: SeedSequence) -> GeometryRow:
    rng = np.random.default_rng(seed)
    points_m = _path(case.geometry, rng)
    beacon_m = points_m[0] + _DISTANCE_M * direction(rng.uniform(-math.pi, math.pi), _POLAR_RAD)
    uav = trajectory(points_m, _SPEED_M_S)
    heard = hear(
        scenario(seed, room(rng, [points_m[0], beacon_m], _RADIO)), uav, standing(beacon_m, uav.t_s[0], uav.t_s[-1])
    )
    aperture = heard.aperture(uav.at(heard.t_s)[0])
    found = Bartlett().estimate(aperture)[0]
    true_azimuth, true_polar = (float(a) for a in angles(beacon_m - np.array(found.reference_p_m)))
    told = informativeness(aperture, true_azimuth, true_polar).source_per_rad2
    return GeometryRow(
        case.geometry,
        aoa_error(found.azimuth_rad, found.polar_rad, true_azimuth, true_polar),
        math.degrees(told**-0.5) if told > 0 else math.inf,
        aperture.packets,
    )


def _path(geometry: str, rng: np.random.Generator) -> Array:
    """Random each time; a plane is that of the floor, as for a ground robot."""
    if geometry == "2D line":
        points = line(_LENGTH_M, _POINTS, rng.uniform(-math.pi, math.pi))
    else:
        points = wander(rng, _LENGTH_M, _POINTS, planar=geometry == "2D curve")
        while geometry == "3D" and _least_extent_m(points) < _MIN_EXTENT_SHARE * _LENGTH_M:
            points = wander(rng, _LENGTH_M, _POINTS, planar=False)
    height_m = _FLYING_M if geometry == "3D" else _DRIVING_M
    return np.asarray(points - points.mean(axis=0) + np.array([0.0, 0.0, height_m]))


def _least_extent_m(points_m: Array) -> float:
    centred = points_m - points_m.mean(axis=0)
    axes = np.linalg.svd(centred.T @ centred)[2]
    return float(np.ptp(centred @ axes[2]))


def _of(rows: Sequence[GeometryRow], geometry: str, measure: str) -> list[float]:
    return [getattr(row.error, measure) for row in rows if row.geometry == geometry]


def _summarise(rows: Sequence[GeometryRow]) -> Summary:
    findings = []
    for geometry, paper in _PAPER_SHARE.items():
        shares = {m: share_below(_of(rows, geometry, m), _LIMIT_DEG) for m in ("paper_deg", "great_circle_deg")}
        findings.append(
            Finding(
                quantity=f"{geometry}: below 10 deg by the paper's measure",
                ours=shares["paper_deg"],
                paper=paper,
                unit="%",
            )
        )
        findings.append(
            Finding(
                quantity=f"{geometry}: below 10 deg on the great circle",
                ours=shares["great_circle_deg"],
                paper=None,
                unit="%",
            )
        )
        for measure, word in (("azimuth_deg", "phi"), ("polar_deg", "theta"), ("paper_deg", "the paper's measure")):
            findings.append(
                Finding(
                    quantity=f"{geometry}: median error, {word}",
                    ours=float(np.median(_of(rows, geometry, measure))),
                    paper=None,
                    unit="deg",
                )
            )
        bounds = [row.crb_deg for row in rows if row.geometry == geometry]
        findings.append(
            Finding(
                quantity=f"{geometry}: median of the great-circle bound",
                ours=float(np.median(bounds)),
                paper=None,
                unit="deg",
            )
        )
    return Summary(
        findings,
        [
            "The paper's measure is the root of the summed squares of azimuth and polar errors, the azimuth wrapped.",
            "A plane sees the source in itself: the profile is flat in the polar angle; a line leaves a cone.",
        ],
    )


def _draw(rows: Sequence[GeometryRow], figure: Figure) -> None:
    first, second, third, last = figure.subplots(1, 4)
    for axes, measure, label in (
        (first, "paper_deg", "AOA error (paper's measure) [deg]"),
        (second, "azimuth_deg", "|phi error| [deg]"),
        (third, "polar_deg", "|theta error| [deg]"),
    ):
        draw_cdf(axes, {g: _of(rows, g, measure) for g in _PAPER_SHARE}, label, (0, 90))
        axes.axvline(_LIMIT_DEG, color="0.7", linewidth=0.8)
    for marker, geometry in zip(MARKERS, _PAPER_SHARE, strict=False):
        chosen = [row for row in rows if row.geometry == geometry]
        # A line's bound is infinite: drawn at the edge.
        bounds = np.minimum([row.crb_deg for row in chosen], 100.0)
        last.loglog(bounds, [row.error.paper_deg for row in chosen], marker, fillstyle="none", label=geometry)
    last.set(xlabel="bound, great circle [deg]; infinite at 100", ylabel="AOA error (paper's measure) [deg]")
    last.grid(color="0.92")
    last.legend(fontsize=7)


STUDY = Study(
    name="geometry",
    title="AOA error of displacement geometries",
    figures=("fig:CDF_phi_theta", "fig:CRB_vs_AOA_error"),
    default_trials=101,
    plan=_plan,
    trial=_trial,
    summarise=_summarise,
    draw=_draw,
    size_in=(17.0, 4.4),
)
