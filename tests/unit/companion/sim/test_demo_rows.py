"""A demo's log beside the truth: one row an iteration, and what the vehicle received when."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from numpy.random import SeedSequence

from companion.core.clock import NS_PER_S
from companion.core.streams import BEARING
from companion.log.records import LoggedEstimate, LoggedIteration
from companion.log.writer import LogWriter
from companion.sim.demo import DemoRun
from companion.sim.demo_rows import summarise
from companion.sim.scenario import RadioScenario, Scenario
from companion.sim.truth import WorldTruth
from companion.study.link import scenario
from tests.vehicle_truth import vehicle_truth


class _Stage:
    """Of the stage a summary asks these two."""

    transport = "unix"
    scenario: Scenario = scenario(SeedSequence(1), RadioScenario())


def _truth(t_s: float, setpoints: int, in_offboard: int, mode: str = "OFFBOARD") -> WorldTruth:
    """The beacon 5 m East of a vehicle at the origin."""
    vehicle = replace(
        vehicle_truth(round(t_s * NS_PER_S), (0.0, 0.0, 1.5), mode=mode),
        setpoints=setpoints, setpoints_in_offboard=in_offboard, offboard_s=in_offboard / 20,
    )  # fmt: skip
    return WorldTruth(
        t_mono_ns=vehicle.t_mono_ns, vehicle=vehicle, uav_antenna_enu_m=(0.0, 0.0, 1.5),
        beacon_antenna_enu_m=(5.0, 0.0, 1.5), beacon_v_enu_m_s=(0.0, 0.0, 0.0), distance_m=5.0, exchanges=0,
    )  # fmt: skip


def _run(truths: Sequence[WorldTruth]) -> DemoRun:
    return DemoRun(
        reached=True, outcome="rendezvous", engaged_ns=10 * NS_PER_S, flight_s=20.0, setup_s=3.0, closest_m=1.9,
        truths=list(truths), stage=_Stage(),  # type: ignore[arg-type]
    )  # fmt: skip


def _log(path: Path, *iterations: LoggedIteration) -> Path:
    with path.open("wb") as file:
        writer = LogWriter(file, {"role": "uav", "name": "uav", "config": "{}"})
        for number, one in enumerate(iterations):
            writer.write(BEARING, number, number, number, message=one)
        writer.finish()
    return path


def _iteration(number: int, t_s: float, estimate: LoggedEstimate | None) -> LoggedIteration:
    return LoggedIteration(
        number=number, peer=2, start_ns=0, end_ns=1, reference_ns=round(t_s * NS_PER_S), received=90,
        estimate=estimate, refusal="" if estimate else "too short",
    )  # fmt: skip


_ESTIMATE = LoggedEstimate(
    azimuth_rad=math.radians(3.0), polar_rad=math.pi / 2, reliability=0.8, packets=80, length_m=1.2, crb_rad=0.01
)
_FLIGHT = [_truth(10.0 + 0.5 * n, 20 + 10 * n, 10 * n, "HOLD" if n == 0 else "OFFBOARD") for n in range(21)]


def test_each_iteration_is_held_against_the_truth_of_its_own_time(tmp_path: Path) -> None:
    level = replace(_ESTIMATE, polar_observable=False)
    log = _log(
        tmp_path / "log.mcap", _iteration(1, 12.0, _ESTIMATE), _iteration(2, 14.0, None), _iteration(3, 15.0, level),
        _iteration(4, 99.0, _ESTIMATE),
    )  # fmt: skip
    result, profile, last = summarise(_run(_FLIGHT), log)
    first, refused, flat = result.rows
    assert (first.time_s, first.packets, first.distance_m) == (2.0, 80, 5.0)
    assert (first.azimuth_deg, first.true_azimuth_deg) == pytest.approx((3.0, 0.0))
    assert first.error_deg == pytest.approx(3.0)
    assert first.crb_deg == pytest.approx(math.degrees(0.01))
    assert (refused.refusal, refused.error_deg, refused.packets) == ("too short", None, 90)
    assert flat.elevation_deg is None
    assert flat.error_deg == pytest.approx(3.0)
    assert result.mean_error_deg == pytest.approx(3.0)
    assert (profile, last) == (None, None), "without a profile there is none to draw"


def test_set_points_are_counted_before_in_and_after_offboard(tmp_path: Path) -> None:
    log = _log(tmp_path / "log.mcap")
    result, _, _ = summarise(_run(_FLIGHT), log)
    assert result.setpoints_before_offboard == 20
    assert result.setpoints_after_offboard == 0
    assert result.mean_setpoint_rate_hz == pytest.approx(20.0)
    assert result.lowest_setpoint_rate_hz == pytest.approx(20.0)
    badly = [*_FLIGHT, _truth(21.0, 20 + 200 + 7, 200, "HOLD")]
    assert summarise(_run(badly), log)[0].setpoints_after_offboard == 7


def test_who_never_flew_has_no_rates(tmp_path: Path) -> None:
    result, _, _ = summarise(_run([]), _log(tmp_path / "log.mcap"))
    assert (result.mean_setpoint_rate_hz, result.lowest_setpoint_rate_hz, result.setpoints_before_offboard) == (0, 0, 0)
    assert result.mean_error_deg is None
