"""The log of a demo run beside the truth: one row for each SAR iteration, and the figures of the run."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from companion.core.clock import NS_PER_S
from companion.core.streams import BEARING, PROFILE
from companion.log.foxglove import power_of
from companion.log.reader import read_log
from companion.log.records import LoggedIteration, TruthTrack
from companion.sim.demo import BEACON, DemoRun, log_truths
from companion.sim.truth import WorldTruth
from wsr.directions import AZIMUTH_RAD, POLAR_RAD, Profile


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One SAR iteration against the truth at its own reference point and time; angles in degrees, elevations above the
    horizon."""

    iteration: int
    time_s: float
    """Of the reference point, since engaging."""
    packets: int
    length_m: float | None
    azimuth_deg: float | None
    true_azimuth_deg: float
    elevation_deg: float | None
    true_elevation_deg: float
    error_deg: float | None
    """Great circle between estimate and truth, along the horizon where the aperture told no elevation."""
    crb_deg: float | None
    """Square root of the unknown-phase Cramer-Rao bound, as a great circle."""
    reliability: float | None
    distance_m: float
    refusal: str
    uav_m: tuple[float, float, float]
    beacon_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoResult:
    """What `--json` holds."""

    seed: int
    reached: bool
    outcome: str
    transport: str
    flight_s: float
    setup_s: float
    closest_m: float
    mean_error_deg: float | None
    mean_setpoint_rate_hz: float
    lowest_setpoint_rate_hz: float
    """In the worst second of offboard flight."""
    setpoints_before_offboard: int
    """Before the autopilot first granted OFFBOARD, which it does only to a running stream."""
    setpoints_after_offboard: int
    """Outside OFFBOARD at any time after that: a companion that behaves sends none."""
    rows: list[Row]


def summarise(run: DemoRun, log: Path) -> tuple[DemoResult, Profile | None, LoggedIteration | None]:
    """The result, the last AOA profile and the iteration it belongs to (None when there was none)."""
    messages = read_log(log, {BEARING.topic, PROFILE.topic})
    iterations = [msgspec.json.decode(m.data, type=LoggedIteration) for m in messages if m.topic == BEARING.topic]
    profiles = [m.data for m in messages if m.topic == PROFILE.topic]
    track = TruthTrack(log_truths(run.truths))
    # An iteration from before the first truth or after the last has no error: the vehicle was elsewhere by then.
    rows = [row for iteration in iterations if (row := _row(iteration, run, track)) is not None]
    errors = [row.error_deg for row in rows if row.error_deg is not None]
    last = run.truths[-1].vehicle if run.truths else None
    in_offboard = last.setpoints_in_offboard if last else 0
    before = _outside_until_offboard(run.truths)
    result = DemoResult(
        seed=run.stage.scenario.seed,
        reached=run.reached,
        outcome=run.outcome,
        transport=run.stage.transport,
        flight_s=run.flight_s,
        setup_s=run.setup_s,
        closest_m=run.closest_m,
        mean_error_deg=float(np.mean(errors)) if errors else None,
        mean_setpoint_rate_hz=in_offboard / last.offboard_s if last and last.offboard_s else 0.0,
        lowest_setpoint_rate_hz=_lowest_rate_hz(run.truths),
        setpoints_before_offboard=before,
        setpoints_after_offboard=last.setpoints - in_offboard - before if last else 0,
        rows=rows,
    )
    estimated = [iteration for iteration in iterations if iteration.estimate is not None]
    if not profiles or not estimated:
        return result, None, None
    return result, Profile(power_of(profiles[-1]), AZIMUTH_RAD, POLAR_RAD), estimated[-1]


def _lowest_rate_hz(truths: list[WorldTruth]) -> float:
    """Over all windows of one second that lie wholly in OFFBOARD; 0 without any."""
    flown = [truth.vehicle for truth in truths if truth.vehicle.mode == "OFFBOARD"]
    t_s = np.array([vehicle.t_mono_ns for vehicle in flown]) / NS_PER_S
    count = np.array([vehicle.setpoints_in_offboard for vehicle in flown], float)
    start = np.flatnonzero(t_s <= (t_s[-1] - 1.0 if len(t_s) else 0.0))
    if not len(start):
        return 0.0
    return float(np.min(np.interp(t_s[start] + 1.0, t_s, count) - count[start]))


def _outside_until_offboard(truths: list[WorldTruth]) -> int:
    for world in truths:
        if world.vehicle.setpoints_in_offboard:
            return world.vehicle.setpoints - world.vehicle.setpoints_in_offboard
    return truths[-1].vehicle.setpoints if truths else 0


def _row(iteration: LoggedIteration, run: DemoRun, track: TruthTrack) -> Row | None:
    """None where the truth does not know."""
    bearing = track.bearing(iteration.reference_ns, BEACON)
    if bearing is None:
        return None
    true_azimuth, true_polar = bearing
    uav, beacon = track.places_m(iteration.reference_ns, BEACON)
    estimate = iteration.estimate
    error_deg = None if estimate is None else track.error_deg(iteration.reference_ns, BEACON, estimate)
    ux, uy, uz = uav.tolist()
    bx, by, bz = beacon.tolist()
    return Row(
        iteration=iteration.number,
        time_s=(iteration.reference_ns - run.engaged_ns) / NS_PER_S,
        packets=estimate.packets if estimate else iteration.received,
        length_m=estimate.length_m if estimate else None,
        azimuth_deg=math.degrees(estimate.azimuth_rad) if estimate else None,
        true_azimuth_deg=math.degrees(true_azimuth),
        elevation_deg=90.0 - math.degrees(estimate.polar_rad) if estimate and estimate.polar_observable else None,
        true_elevation_deg=90.0 - math.degrees(true_polar),
        error_deg=error_deg,
        crb_deg=math.degrees(estimate.crb_rad) if estimate and estimate.crb_rad is not None else None,
        reliability=estimate.reliability if estimate else None,
        distance_m=float(np.linalg.norm(beacon - uav)),
        refusal=iteration.refusal,
        uav_m=(ux, uy, uz),
        beacon_m=(bx, by, bz),
    )
