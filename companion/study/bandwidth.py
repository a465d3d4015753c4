"""`bandwidth`: the error of a bearing by the width of an AX card's packets, which the paper's 20 MHz leaves open.

A trial is one room and one aperture: a leg as the vehicle flies it, 1.2 m, 15 m from the other robot, the rooms those
of the missions. What differs is the width alone; a wider packet has as much less power on each subcarrier.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.random import SeedSequence

from companion.sim.scenario import RadioScenario, Scenario, ax210_radio
from companion.sim.scenes import FLIGHT_HEIGHT_M, set_in
from companion.sim.trajectory import Trajectory
from companion.study.angles import AoaError, aoa_error, share_below
from companion.study.figures import draw_cdf
from companion.study.leg import LegShape, plan_leg
from companion.study.link import hear_ax, scenario, standing
from companion.study.paths import Array
from companion.study.study import Finding, Settings, Study, Summary
from wsr.estimators.robust import Robust
from wsr.geometry import angles, direction

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Width = Literal[20, 40, 80, 160]

WIDTHS_MHZ: Final[tuple[Width, ...]] = (20, 40, 80, 160)
ROOMS: Final = ("hall", "occluded", "hard", "hard-10db", "hard-14db", "furniture")
"""Of `companion.sim.scenes`: in `occluded`, `hard-10db` and `hard-14db` something stands before the direct path."""
_SHAPE: Final = LegShape(length_m=1.2, lateral_m=0.12, vertical_m=0.1, speed_m_s=0.5, acceleration_m_s2=0.8)
_RATE_HZ: Final = 150.0
_HEIGHT_M: Final = 0.5
_HEADING_STD_RAD: Final = 0.3
_LIMIT_DEG: Final = 10.0


@dataclass(frozen=True, slots=True)
class BandwidthCase:
    room: str
    number: int


@dataclass(frozen=True, slots=True)
class BandwidthRow:
    """Errors of one aperture by the width of its packets, in MHz."""

    room: str
    errors: dict[int, AoaError]


def _plan(settings: Settings) -> list[BandwidthCase]:
    return [BandwidthCase(room, number) for room in ROOMS for number in range(settings.trials)]


def _trial(case: BandwidthCase, seed: SeedSequence) -> BandwidthRow:
    own = SeedSequence(seed.entropy, spawn_key=(zlib.crc32(case.room.encode()), case.number))
    rng = np.random.default_rng(own)
    base = set_in(scenario(own, RadioScenario(exchange_rate_hz=_RATE_HZ)), case.room)
    assert base.beacon_azimuth_rad is not None
    beacon_m = base.start_distance_m * direction(base.beacon_azimuth_rad, math.pi / 2)
    beacon_m[2] = _HEIGHT_M
    heading = base.beacon_azimuth_rad + rng.normal(0.0, _HEADING_STD_RAD)
    leg = plan_leg((0.0, 0.0, FLIGHT_HEIGHT_M), heading, FLIGHT_HEIGHT_M, int(rng.choice([-1, 1])), shape=_SHAPE)
    uav = Trajectory(1.0 + leg.t_s, leg.p_local_enu_m, np.zeros(leg.t_s.size))
    return BandwidthRow(case.room, {width: _error(base, width, uav, beacon_m) for width in WIDTHS_MHZ})


def _error(base: Scenario, width: Width, uav: Trajectory, beacon_m: Array) -> AoaError:
    world = replace(base, radio=ax210_radio(base.radio, width))
    heard = hear_ax(world, uav, standing(beacon_m, uav.t_s[0], uav.t_s[-1]))
    found = Robust().estimate(heard.aperture(uav.at(heard.t_s)[0]))[0]
    azimuth, polar = (float(a) for a in angles(beacon_m - np.array(found.reference_p_m)))
    return aoa_error(found.azimuth_rad, found.polar_rad, azimuth, polar)


def _summarise(rows: Sequence[BandwidthRow]) -> Summary:
    findings = []
    for room in ROOMS:
        for width in WIDTHS_MHZ:
            errors = [row.errors[width] for row in rows if row.room == room]
            if not errors:
                continue
            head = f"{room}, {width} MHz"
            circle = [error.great_circle_deg for error in errors]
            azimuth = float(np.mean([error.azimuth_deg for error in errors]))
            findings.append(
                Finding(quantity=f"{head}: mean azimuth error", ours=azimuth, paper="left open", unit="deg")
            )
            findings.append(
                Finding(
                    quantity=f"{head}: mean great circle", ours=float(np.mean(circle)), paper="left open", unit="deg"
                )
            )
            findings.append(
                Finding(
                    quantity=f"{head}: below 10 deg", ours=share_below(circle, _LIMIT_DEG), paper="left open", unit="%"
                )
            )
    return Summary(findings, list(_NOTES))


_NOTES = (
    "Simulated AX cards with chains of random sign, no counters, answers from user space: no hardware has run it.",
    "A floor's echo comes 0.1 to 0.2 m later, which no width tells apart: it moves the elevation.",
)


def _draw(rows: Sequence[BandwidthRow], figure: Figure) -> None:
    panels = figure.subplots(2, 3)
    for axes, room in zip(panels.ravel(), ROOMS, strict=True):
        chosen = [row for row in rows if row.room == room]
        groups = {f"{width} MHz": [row.errors[width].great_circle_deg for row in chosen] for width in WIDTHS_MHZ}
        draw_cdf(axes, groups, "great circle error [deg]", (0, 40))
        axes.set_title(room, fontsize=9)


STUDY = Study(
    name="bandwidth",
    title="AOA error by the width of the packets",
    figures=("none: the paper measures at 20 MHz",),
    default_trials=40,
    plan=_plan,
    trial=_trial,
    summarise=_summarise,
    draw=_draw,
    size_in=(14.0, 8.0),
)
