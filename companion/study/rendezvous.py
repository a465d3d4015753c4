"""`rendezvous`: simulated missions through named scenes (labels fig:HW_application_stats,
fig:HW_application_stats_crb_error).

A mission is flown until the vehicle calls itself arrived or ends otherwise, four minutes at most; every mission has its
own room, crystals, gusts and errors of camera and autopilot, and mission n of a scene is the same one whatever else is
flown. How far away the robot is and how far off North is the scene says, or they are drawn as a belief expects them:
only then has its NEES a mean of 3.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.random import SeedSequence

from companion.config.schema import PingConfig
from companion.flight.commands import WARM_UP_S
from companion.sensing.frame_turn import NORTH_STD_RAD
from companion.sim.scenario import RadioScenario, Scenario, VioScenario
from companion.sim.scenes import FLOWN, scene_names, set_in
from companion.study import rendezvous_figures
from companion.study.angles import aoa_error
from companion.study.belief import BeliefCheck, check
from companion.study.link import scenario
from companion.study.rendezvous_rows import FlownIteration, MissionRow
from companion.study.straight import straight_flight_s
from companion.study.study import Settings, Study
from companion.study.virtual_mission import BEACON_LEVER_M, LEVER_M, RENDEZVOUS_M, MissionPoint, config, fly
from wsr.geometry import angles

MAX_TIME_S = 240.0
_VIO_RATE_HZ = 50.0  # a pose a centimetre at 0.5 m/s; a T265 gives 200, whose errors have the same size
_PING_RATE_HZ = PingConfig().rate_hz
_DRAWN_STREAM: Final = 8
DRAWN_M: Final = (3.0, 35.0)
"""Distances are drawn from these, evenly: nearer there is nothing to look for."""


@dataclass(frozen=True, slots=True)
class MissionCase:
    scene: str
    number: int
    chooses_motion: bool = True
    draws_truths: bool = False
    """Its distance and what both robots take for North are drawn, in place of the scene's."""


def _plan(settings: Settings) -> list[MissionCase]:
    names = scene_names(settings.scenes, FLOWN) or FLOWN
    chosen, drawn = settings.motion == "chosen", settings.truths == "drawn"
    return [MissionCase(names[i % len(names)], i // len(names), chosen, drawn) for i in range(settings.trials)]


def world(case: MissionCase, seed: SeedSequence) -> Scenario:
    """What a mission is flown in."""
    own = _own(case, seed)
    base = replace(scenario(own, RadioScenario(exchange_rate_hz=_PING_RATE_HZ)), vio=VioScenario(rate_hz=_VIO_RATE_HZ))
    if not case.draws_truths:
        return set_in(base, case.scene)
    rng = np.random.default_rng([base.seed, _DRAWN_STREAM])
    distance_m, (own_rad, beacon_rad) = rng.uniform(*DRAWN_M), rng.normal(0.0, NORTH_STD_RAD, 2).tolist()
    placed = set_in(base, case.scene, distance_m=float(distance_m), north_error_rad=own_rad)
    return replace(placed, beacon=replace(placed.beacon, frame_yaw_rad=placed.beacon.frame_yaw_rad + beacon_rad))


def _own(case: MissionCase, seed: SeedSequence) -> SeedSequence:
    return SeedSequence(seed.entropy, spawn_key=(zlib.crc32(case.scene.encode()), case.number))


def _trial(case: MissionCase, seed: SeedSequence) -> MissionRow:
    around = world(case, seed)
    limits = config().mission
    start_m = (LEVER_M[0], LEVER_M[1], limits.takeoff_height_m + LEVER_M[2])
    straight_s = straight_flight_s(
        around,
        start_m,
        BEACON_LEVER_M,
        RENDEZVOUS_M,
        speed_m_s=limits.speed_m_s,
        acceleration_m_s2=limits.acceleration_m_s2,
        begins_s=WARM_UP_S,
    )
    result = fly(around, _own(case, seed), MAX_TIME_S, chooses_motion=case.chooses_motion)
    return MissionRow(
        scene=case.scene,
        number=case.number,
        time_s=round(result.time_s, 2),
        straight_s=round(straight_s, 2),
        end=result.end,
        closest_m=round(result.closest_m, 3),
        reached_s=_rounded(result.reached_s, 2),
        arrived_m=_rounded(result.arrived_m, 3),
        left_room=result.left_room,
        draws_truths=case.draws_truths,
        steps=[_step(point) for point in result.points],
    )


def _step(point: MissionPoint) -> FlownIteration:
    iteration, estimate = point.iteration, point.iteration.estimate
    azimuth, polar = (float(a) for a in angles(np.subtract(point.beacon_enu_m, point.uav_enu_m)))
    told = iteration.informativeness
    error = None if estimate is None else aoa_error(estimate.azimuth_rad, estimate.polar_rad, azimuth, polar)
    return FlownIteration(
        number=iteration.number,
        time_s=round(point.time_s, 2),
        distance_m=round(math.dist(point.beacon_enu_m, point.uav_enu_m), 3),
        beacon_moving=point.is_beacon_moving,
        azimuth_deg=None if error is None else round(error.azimuth_deg, 3),
        paper_deg=None if error is None else round(error.paper_deg, 3),
        great_circle_deg=None if error is None else round(error.great_circle_deg, 3),
        crb_deg=None if estimate is None else _rounded(math.degrees(estimate.crb_rad), 4),
        informativeness_deg=None if told is None else _bound_deg(told.source_per_rad2),
        reliability=None if estimate is None else round(estimate.reliability, 3),
        refusal=iteration.refusal,
        belief=_belief(point),
    )


def _belief(point: MissionPoint) -> BeliefCheck | None:
    iteration = point.iteration
    if point.target is None or iteration.p_local_enu_m is None or iteration.peer_p_enu_m is None:
        return None
    x, y, z = (p + off for p, off in zip(point.beacon_enu_m, point.local_off_m, strict=True))
    found = check(point.target, iteration.peer_p_enu_m, (x, y, z), iteration.p_local_enu_m)
    return found._replace(nees=round(found.nees, 3))


def _bound_deg(per_rad2: float) -> float | None:
    return round(math.degrees(per_rad2**-0.5), 4) if per_rad2 > 0 else None


def _rounded(value: float | None, digits: int) -> float | None:
    return round(value, digits) if value is not None and math.isfinite(value) else None


STUDY = Study(
    name="rendezvous",
    title="Simulated rendezvous missions",
    figures=("fig:HW_application_stats", "fig:HW_application_stats_crb_error"),
    default_trials=240,
    plan=_plan,
    trial=_trial,
    summarise=rendezvous_figures.summarise,
    draw=rendezvous_figures.draw,
    size_in=(20.0, 9.0),
    row=MissionRow,
    table=rendezvous_figures.table,
)
