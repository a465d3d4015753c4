"""`packets`: AOA error against packet loss and element spacing, which the paper leaves open (its "Discretization").

One leg as the vehicle flies it, 1.2 m, a source 8 m away. Packets are taken from one simulated recording: at random, in
bursts (a two-state Markov chain, 20 packets a burst on average), or all but every n-th, as if pings were that sparse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from numpy.random import SeedSequence

from companion.sim.scenario import RadioScenario
from companion.sim.trajectory import Trajectory
from companion.study.angles import aoa_error
from companion.study.figures import draw_lines
from companion.study.leg import LegShape, plan_leg
from companion.study.link import Heard, hear, room, scenario, standing
from companion.study.paths import Array
from companion.study.study import Finding, Settings, Study, Summary
from wsr.aoa import Estimator
from wsr.channel import wavelength_m
from wsr.errors import ApertureError
from wsr.estimators.bartlett import Bartlett
from wsr.estimators.robust import Robust
from wsr.geometry import angles, direction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Mask = npt.NDArray[np.bool_]

_RADIO = RadioScenario(exchange_rate_hz=150.0, loss_probability=0.0)
_SHAPE = LegShape(length_m=1.2, lateral_m=0.12, vertical_m=0.1, speed_m_s=0.5, acceleration_m_s2=0.8)
_DISTANCE_M = 8.0
_LOSSES = (0.0, 0.25, 0.5, 0.75, 0.9, 0.95)
_BURST_PACKETS = 20.0
_STRIDES = (1, 2, 4, 8, 16, 24)
_MIN_PACKETS = 5
_RANDOM, _BURSTY, _SPARSE = "random loss", "bursty loss", "sparse pings"
_ESTIMATORS = ("bartlett", "robust")
_LIMIT_DEG = 10.0


@dataclass(frozen=True, slots=True)
class PacketsCase:
    """Every condition is tried on each recording."""


@dataclass(frozen=True, slots=True)
class PacketsResult:
    """One condition: `value` is the share lost, or the mean spacing of elements [m]. An error is None for a refusal."""

    condition: str
    value: float
    packets: int
    error_deg: dict[str, float | None]


@dataclass(frozen=True, slots=True)
class PacketsRow:
    results: list[PacketsResult]


def _plan(settings: Settings) -> list[PacketsCase]:
    return [PacketsCase()] * settings.trials


def _trial(case: PacketsCase, seed: SeedSequence) -> PacketsRow:
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(-math.pi, math.pi)
    leg = plan_leg((0.0, 0.0, 1.5), bearing + rng.normal(0.0, 0.3), 1.5, int(rng.choice([-1, 1])), shape=_SHAPE)
    uav = Trajectory(1.0 + leg.t_s, leg.p_local_enu_m, np.zeros(leg.t_s.size))
    beacon_m = np.array([0.0, 0.0, 0.5]) + _DISTANCE_M * direction(bearing, math.pi / 2)
    world = scenario(seed, room(rng, [leg.p_local_enu_m[0], beacon_m], _RADIO))
    heard = hear(world, uav, standing(beacon_m, uav.t_s[0], uav.t_s[-1]))
    p_m = uav.at(heard.t_s)[0]
    count = heard.t_s.size
    masks = [(_RANDOM, loss, rng.random(count) >= loss) for loss in _LOSSES]
    masks += [(_BURSTY, loss, _bursts(rng, count, loss)) for loss in _LOSSES]
    spacing_m = _SHAPE.length_m / count
    masks += [(_SPARSE, spacing_m * n, np.arange(count) % n == 0) for n in _STRIDES]
    return PacketsRow([_result(name, value, mask, heard, p_m=p_m, beacon_m=beacon_m) for name, value, mask in masks])


def _bursts(rng: np.random.Generator, count: int, loss: float) -> Mask:
    """Kept packets of a chain that loses all in its bad state, where it stays for 20 packets on average."""
    leave_bad = 1 / _BURST_PACKETS
    leave_good = leave_bad * loss / (1 - loss)
    good = rng.random() >= loss
    kept = np.empty(count, np.bool_)
    for i, luck in enumerate(rng.random(count)):
        kept[i] = good
        good = luck >= leave_good if good else luck < leave_bad
    return kept


def _result(name: str, value: float, mask: Mask, heard: Heard, *, p_m: Array, beacon_m: Array) -> PacketsResult:
    estimators: dict[str, Estimator] = {"bartlett": Bartlett(), "robust": Robust()}
    errors: dict[str, float | None] = {}
    for key, estimator in estimators.items():
        try:
            found = estimator.estimate(heard.aperture(p_m, keep=mask, min_packets=_MIN_PACKETS))[0]
        except ApertureError:
            errors[key] = None
            continue
        azimuth, polar = (float(a) for a in angles(beacon_m - np.array(found.reference_p_m)))
        errors[key] = aoa_error(found.azimuth_rad, found.polar_rad, azimuth, polar).great_circle_deg
    return PacketsResult(name, value, int(np.count_nonzero(mask)), errors)


def _conditions(rows: Sequence[PacketsRow]) -> list[list[PacketsResult]]:
    """The results of all recordings, condition by condition, in the order of the first."""
    return [list(results) for results in zip(*(row.results for row in rows), strict=True)]


def _median_deg(results: Sequence[PacketsResult], estimator: str) -> float:
    """A refusal counts as no bearing at all, 180 degrees off."""
    return float(np.median([180.0 if e is None else e for e in (r.error_deg[estimator] for r in results)]))


def _within(results: Sequence[PacketsResult], estimator: str) -> float:
    errors = [r.error_deg[estimator] for r in results]
    return 100.0 * float(np.mean([e is not None and e < _LIMIT_DEG for e in errors]))


def _summarise(rows: Sequence[PacketsRow]) -> Summary:
    findings = []
    quarter_mm = 250 * wavelength_m(_RADIO.channel)
    for results in _conditions(rows):
        first = results[0]
        mean_packets = float(np.mean([r.packets for r in results]))
        spacing_mm = 1e3 * float(np.mean([r.value for r in results]))
        value = f"{spacing_mm:.1f} mm" if first.condition == _SPARSE else f"{first.value:.0%}"
        for estimator in _ESTIMATORS:
            head = f"{first.condition} {value} ({mean_packets:.0f} packets), {estimator}"
            findings.append(
                Finding(quantity=f"{head}: below 10 deg", ours=_within(results, estimator), paper="left open", unit="%")
            )
            findings.append(
                Finding(
                    quantity=f"{head}: median error",
                    ours=_median_deg(results, estimator),
                    paper="left open",
                    unit="deg",
                )
            )
    return Summary(
        findings,
        [
            f"A quarter of a wavelength, what a uniform line would need for the product, is {quarter_mm:.1f} mm.",
            "Great-circle errors; a refusal (too few packets) counts as no bearing.",
        ],
    )


def _draw(rows: Sequence[PacketsRow], figure: Figure) -> None:
    conditions = _conditions(rows)
    panels = figure.subplots(1, 3)
    for axes, name in zip(panels, (_RANDOM, _BURSTY, _SPARSE), strict=True):
        chosen = [results for results in conditions if results[0].condition == name]
        scale, label = (1e3, "mean spacing [mm]") if name == _SPARSE else (100.0, "share lost [%]")
        x = [scale * float(np.mean([r.value for r in results])) for results in chosen]
        groups = {e: [_within(results, e) for results in chosen] for e in _ESTIMATORS}
        draw_lines(axes, x, groups, label, ylabel="below 10 deg [%]")
        axes.set(title=name, ylim=(0, 102))
        if name == _SPARSE:
            axes.axvline(250 * wavelength_m(_RADIO.channel), color="0.6", linewidth=0.8)


STUDY = Study(
    name="packets",
    title="AOA error against packet loss and element spacing",
    figures=("Discretization",),
    default_trials=40,
    plan=_plan,
    trial=_trial,
    summarise=_summarise,
    draw=_draw,
    size_in=(13.0, 4.2),
)
