"""What an analysis found, summed up: lines for people, sums by set, plain JSON values for programs."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from companion.analysis.result import DEFAULT_LEVERS_M, NO_LEVER, LinkResult, RunResult
from companion.analysis.trajectories import PoseKind
from companion.core.messages import Vector3

Json = dict[str, object]

_FAR_DEG = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SetSummary:
    """Azimuth errors over the links of a set (the folder above the runs); None where there are none."""

    name: str
    links: int
    """Those with an azimuth."""
    of_links: int
    """Those whose truth is known or that failed."""
    median_deg: float | None
    mean_deg: float | None
    share_below_10_deg: float | None


def problem_lines(result: RunResult) -> list[str]:
    """One line for each thing that is wrong with a run or its links."""
    lines = _run_problems(result)
    for link in result.links:
        said = link.notes if link.problem is None else (*link.notes, link.problem)
        lines += [f"{link.name}: {text}" for text in said]
    return list(dict.fromkeys(lines))


def note_lines(result: RunResult) -> list[str]:
    """What was used and assumed."""
    lines = [] if result.trajectory is None else [f"trajectory {result.trajectory}, read as {result.layout}"]
    lines += [f"trajectory of {link.name}: {link.trajectory}" for link in result.links if link.trajectory is not None]
    if result.kind is not PoseKind.ODOM or result.lever_m == NO_LEVER:
        return lines
    return [*lines, lever_line(result.lever_m)]


def lever_line(lever_m: Vector3) -> str:
    """Where the antenna is taken to be."""
    forward_m, left_m, up_m = lever_m
    whose = "that of the WSR robot; --lever gives another" if lever_m == DEFAULT_LEVERS_M[PoseKind.ODOM] else "as given"
    return f"antenna {forward_m:g} m forward, {left_m:g} m left, {up_m:g} m up of the tracked point ({whose})"


def summarise(results: Sequence[RunResult]) -> list[SetSummary]:
    """Azimuth errors by set, where the truth is known."""
    groups: dict[str, list[LinkResult]] = defaultdict(list)
    for result in results:
        groups[result.run.set_name] += result.links
    return [_summary(name, links) for name, links in sorted(groups.items()) if any(link.truth for link in links)]


def as_json(results: Sequence[RunResult]) -> Json:
    """The whole result; angles in degrees, None where there is no value or it is infinite. Polar angles are from Up, as
    in the paper, and elevations above the horizon: 90 degrees less the polar angle."""
    return {
        "runs": [_run_json(result) for result in results],
        "sets": [
            {
                "set": row.name,
                "links": row.links,
                "of_links": row.of_links,
                "median_deg": row.median_deg,
                "mean_deg": row.mean_deg,
                "share_below_10_deg": row.share_below_10_deg,
            }
            for row in summarise(results)
        ],
    }


def _summary(name: str, links: Sequence[LinkResult]) -> SetSummary:
    known = [link for link in links if link.truth is not None or link.estimate is None]
    errors = np.degrees([abs(link.azimuth_error_rad) for link in links if link.azimuth_error_rad is not None])
    if not len(errors):
        return SetSummary(
            name=name, links=0, of_links=len(known), median_deg=None, mean_deg=None, share_below_10_deg=None
        )
    share = float(np.mean(errors < _FAR_DEG))
    return SetSummary(
        name=name,
        links=len(errors),
        of_links=len(known),
        median_deg=float(np.median(errors)),
        mean_deg=float(np.mean(errors)),
        share_below_10_deg=share,
    )


def _run_json(result: RunResult) -> Json:
    return {
        "run": result.run.stamp,
        "set": result.run.set_name,
        "folder": str(result.run.folder),
        "poses": result.kind,
        "trajectory": None if result.trajectory is None else str(result.trajectory),
        "trajectory_layout": result.layout or None,
        "lever_m": list(result.lever_m),
        "problems": _run_problems(result),
        "links": [_link_json(link) for link in result.links],
    }


def _run_problems(result: RunResult) -> list[str]:
    return [*result.missing, *result.problems, *([] if result.failure is None else [result.failure])]


def _link_json(link: LinkResult) -> Json:
    values: Json = {
        "tx": link.name,
        "mac": link.mac,
        "trajectory": None if link.trajectory is None else str(link.trajectory),
        "problem": link.problem,
        "notes": list(link.notes),
        "packets": link.packets,
        "used": link.used,
        "dropped": dict(link.dropped),
        "true_azimuth_deg": _deg(link.truth.azimuth_rad if link.truth else None),
        "true_polar_deg": _deg(link.truth.polar_rad if link.truth else None),
        "true_elevation_deg": _elevation_deg(link.truth.polar_rad if link.truth else None),
        "truth_problem": link.truth_problem,
        "azimuth_error_deg": _deg(link.azimuth_error_rad),
        "great_circle_error_deg": _deg(link.great_circle_error_rad),
    }
    found = link.estimate
    if found is None:
        return {**values, "azimuth_deg": None, "polar_deg": None, "elevation_deg": None}
    polar_rad = found.polar_rad if found.polar_observable else None
    return {
        **values,
        "azimuth_deg": math.degrees(found.azimuth_rad) if found.azimuth_observable else None,
        "polar_deg": _deg(polar_rad),
        "elevation_deg": _elevation_deg(polar_rad),
        "azimuth_std_deg": _number(math.degrees(found.azimuth_std_rad)),
        "polar_std_deg": _number(math.degrees(found.polar_std_rad)),
        "crb_deg": _number(math.degrees(found.crb_rad)),
        "coherence": found.coherence,
        "reliability": found.reliability,
        "length_m": found.length_m,
        "extents_m": list(found.extents_m),
        "reference_m": list(found.reference_p_m),
        "reference_time_s": found.reference_t_s,
        "range_m": found.range_m,
        "range_std_m": _number(found.range_std_m),
        **{
            name: [
                {
                    "azimuth_deg": math.degrees(peak.azimuth_rad),
                    "polar_deg": math.degrees(peak.polar_rad),
                    "power": peak.power,
                    "relative_power": peak.relative_power,
                    "prominence": peak.prominence,
                    "width_deg": math.degrees(peak.width_rad),
                }
                for peak in peaks
            ]
            for name, peaks in (("alternatives", found.alternatives), ("paths", found.paths))
        },
        "cone": None
        if found.cone is None
        else {
            "axis": list(found.cone.axis),
            "angle_deg": math.degrees(found.cone.angle_rad),
            "angle_std_deg": _number(math.degrees(found.cone.angle_std_rad)),
        },
    }


def _deg(angle_rad: float | None) -> float | None:
    return None if angle_rad is None else math.degrees(angle_rad)


def _elevation_deg(polar_rad: float | None) -> float | None:
    return None if polar_rad is None else 90.0 - math.degrees(polar_rad)


def _number(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
