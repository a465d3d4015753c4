"""What is gathered before the vehicle is engaged: every part as it is now, and the autopilot's parameters."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from companion.autopilot.port import AutopilotError
from companion.config.file import load_config
from companion.config.schema import Config
from companion.core.clock import NS_PER_S
from companion.core.event_clock import EventClock
from companion.core.inputs import Event, Surroundings
from companion.core.messages import FlightMode, VehicleState
from companion.core.streams import SURROUNDINGS
from companion.flight.course import Course
from companion.flight.engagement import Engagement
from tests.kept import Kept
from tests.manual_clock import ManualClock
from tests.paths import CONFIGS

_NOW_NS = 1000 * NS_PER_S
_SHIPPED = load_config(CONFIGS / "uav.yaml")
_CONFIG = replace(_SHIPPED, mission=replace(_SHIPPED.mission, control="fly"))
_RIGHT = {
    "COM_OF_LOSS_T": 1.0,
    "COM_OBL_RC_ACT": 5.0,
    "COM_RC_OVERRIDE": 3.0,
    "GF_ACTION": 2.0,
    "RTL_RETURN_ALT": 2.0,
    "GF_MAX_VER_DIST": 0.0,
    "NAV_MC_ALT_RAD": 0.1,
    "COM_TAKEOFF_ACT": 0.0,
    "SYS_HAS_GPS": 0.0,
    "EKF2_EV_CTRL": 11.0,
    "EKF2_GPS_CTRL": 0.0,
    "EKF2_HGT_REF": 3.0,
    "EKF2_EV_DELAY": 20.0,
}


class _Autopilot:
    """One whose state and parameters a test sets."""

    problem = ""

    def __init__(self) -> None:
        self.vehicle = VehicleState(
            t_mono_ns=_NOW_NS, heartbeat_mono_ns=_NOW_NS, mode=FlightMode.HOLD, position_mono_ns=_NOW_NS,
            p_local_enu_m=(0.0, 0.0, 0.0), yaw_enu_rad=0.0, battery_remaining=0.8, estimator_mono_ns=_NOW_NS,
            estimator_healthy=True, timesync_mono_ns=_NOW_NS, system_id=1, autopilot="px4", clock_offset_ns=5,
        )  # fmt: skip
        self.parameters: dict[str, float] = dict(_RIGHT)

    def state(self) -> VehicleState:
        return self.vehicle

    async def parameter(self, name: str) -> float:
        if name not in self.parameters:
            raise AutopilotError(f"parameter {name} could not be read")
        return self.parameters[name]


class _Others:
    """Poses, what is known of the target and the iterations, all as they should be."""

    id = 2
    age_s = 0.1
    is_ready = True
    is_measuring = False

    class refused:
        bad_key = 0

    class session:
        old_boots = 0

    @property
    def neighbour(self) -> _Others:
        return self

    def problem(self) -> str:
        return ""

    north_problem = problem

    def not_locked(self, now_ns: int) -> str:
        return ""

    def datagram_age_s(self, peer: int) -> float:
        return self.age_s if peer == self.id else math.inf

    packet_age_s = datagram_age_s


class _Stranger(_Others):
    """A robot that is not the target; nobody heard it."""

    id = 3

    class refused:
        bad_key = 7


class _Ground:
    """A service before it engages."""

    def __init__(self, config: Config = _CONFIG, look: Any = None, forward_vio_hz: float = 30.0) -> None:
        assert config.autopilot is not None
        config = replace(config, autopilot=replace(config.autopilot, gps=False, forward_vio_hz=forward_vio_hz))
        self.clock, self.kept, self.autopilot, self.others = ManualClock(_NOW_NS), Kept(), _Autopilot(), _Others()
        self.events = EventClock(self.clock)
        others: Any = self.others
        self.engagement = Engagement(
            config=config,
            clock=self.events,
            intake=others,
            knowledge=others,
            autopilot=self.autopilot,  # type: ignore[arg-type]
            sar=others,
            recorder=self.kept,
            look=look or self._look,
        )
        self.looks = self.bad_signatures = 0
        self.course = Course(self.events, self.kept)

    def _look(self) -> Surroundings:
        self.looks += 1
        checked = self.engagement._look_around().parameters_checked
        return Surroundings(
            t_mono_ns=_NOW_NS, autopilot_problem=self.autopilot.problem, parameters_checked=checked,
            bad_signatures=self.bad_signatures, recorder_failed=False, free_mib=9000.0,
        )  # fmt: skip

    def changed(self, **fields: Any) -> list[str]:
        self.autopilot.vehicle = replace(self.autopilot.vehicle, **fields)
        return self.engagement.not_ready()


def test_nothing_stands_against_a_service_that_is_ready() -> None:
    assert _Ground().engagement.not_ready() == []


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"heartbeat_mono_ns": _NOW_NS - 3 * NS_PER_S}, "no heartbeat of the autopilot"),
        ({"position_mono_ns": _NOW_NS - NS_PER_S}, "the autopilot has no local position"),
        ({"position_mono_ns": _NOW_NS - 2 * NS_PER_S}, "the autopilot has no local position"),
        ({"p_local_enu_m": None}, "the autopilot has no local position"),
        ({"can_arm": False, "arming_reasons": ("accel missing",)}, "PX4's own arming checks fail: accel missing"),
        ({"p_local_enu_m": (30.0, -1.25, 0.0)}, "East 30.0, North -1.2, Up 0.0 m"),
        ({"p_local_enu_m": (0.0, 0.0, 40.0)}, "East 0.0, North 0.0, Up 40.0 m"),
        ({"estimator_mono_ns": _NOW_NS - 4 * NS_PER_S}, "the autopilot's estimator tells nothing of itself"),
        ({"autopilot": "ardupilot"}, "ardupilot"),
        ({"clock_offset_ns": None}, "time"),
        ({"battery_remaining": 0.05}, "battery"),
    ],
)
def test_what_the_vehicle_says_stands_against_it(fields: dict[str, Any], said: str) -> None:
    (line,) = _Ground().changed(**fields)
    assert said in line


def test_who_observes_engages_nobody() -> None:
    (line,) = _Ground(_SHIPPED).engagement.not_ready()
    assert "the service observes" in line, "as the shipped configuration has it"


async def test_parameters_are_read_all_at_once_and_stand_for_half_a_minute() -> None:
    ground = _Ground()
    ground.course.step(Event.ENGAGE, _NOW_NS)
    ground.engagement.check_again(ground.course)
    assert ground.course.worst([]) is Event.PREFLIGHT_FAILED
    assert await ground.engagement.parameter_problems() == []
    ground.engagement.check_again(ground.course)
    assert ground.course.worst([]) is Event.PREFLIGHT_PASSED
    ground.clock.advance(29.5)
    assert ground.engagement._look_around().parameters_checked
    ground.clock.advance(0.5)
    assert not ground.engagement._look_around().parameters_checked


async def test_what_a_return_climbs_by_is_read_anew() -> None:
    ground = _Ground()
    assert await ground.engagement.return_problems() == []
    ground.autopilot.parameters["RTL_RETURN_ALT"] = 30.0
    (high,) = await ground.engagement.return_problems()
    assert high.startswith("parameter RTL_RETURN_ALT is 30; wanted below gate.fence_max_m")
    del ground.autopilot.parameters["GF_MAX_VER_DIST"]
    assert len(await ground.engagement.return_problems()) == 2
    rover = _Ground(replace(_CONFIG, mission=replace(_CONFIG.mission, vehicle="rover")))
    rover.autopilot.parameters.clear()
    assert await rover.engagement.return_problems() == [], "it returns along the ground"


async def test_a_parameter_that_is_wrong_or_was_not_read_is_named_and_nothing_is_remembered() -> None:
    ground = _Ground()
    assert await ground.engagement.parameter_problems() == []
    ground.autopilot.parameters["GF_ACTION"] = 4.0
    del ground.autopilot.parameters["EKF2_HGT_REF"]
    wrong, unread = await ground.engagement.parameter_problems()
    assert wrong.startswith("parameter GF_ACTION is 4") and unread.startswith("parameter EKF2_HGT_REF could not be")
    assert not ground.engagement._look_around().parameters_checked
    ground.autopilot.problem = "no link"
    assert await ground.engagement.parameter_problems() == ["the autopilot's parameters were not read"]


def test_one_look_serves_all_of_one_event_and_is_recorded_with_it() -> None:
    ground = _Ground()
    for _ in range(2):
        with ground.events.event():
            ground.engagement.not_ready()
            ground.engagement.check_again(ground.course)
    assert ground.looks == 2 and ground.kept.topics == [SURROUNDINGS.topic] * 2
    assert all(isinstance(message, Surroundings) for _, _, message in ground.kept.messages)
    ground.engagement.not_ready()
    assert ground.looks == 3 and len(ground.kept.messages) == 2, "outside an event nothing is recorded"


def test_nothing_is_free_where_the_logs_folder_has_gone() -> None:
    gone = replace(_CONFIG, runtime_dir="/nowhere", recorder=replace(_CONFIG.recorder, path="/nowhere/log.mcap"))
    assert _Ground(gone).engagement._look_around().free_mib == 0.0


def test_free_space_is_told_in_mib(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=7 << 19))
    assert _Ground().engagement._look_around().free_mib == 3.5


def test_it_names_the_vehicle_it_would_engage() -> None:
    assert _Ground().engagement.vehicle == "system 1, px4"


@pytest.mark.parametrize(("rate_hz", "said"), [(0.0, False), (0.5, True), (30.0, True)])
def test_the_vehicles_time_is_needed_by_who_sends_it_poses(rate_hz: float, said: bool) -> None:
    ground = _Ground(forward_vio_hz=rate_hz)
    assert any("own time is not known" in line for line in ground.changed(clock_offset_ns=None)) is said


def test_wrong_signatures_are_told_of_the_robot_that_is_asked_for() -> None:
    ground = _Ground()
    ground.bad_signatures = 4
    ground.others.age_s = 60.0
    stranger: Any = _Stranger()
    assert [line for line in ground.engagement.not_ready() if "(4 came with a wrong signature" in line]
    assert [line for line in ground.engagement.not_ready(stranger) if "(7 came with a wrong signature" in line]


async def test_the_ceiling_is_that_of_the_fence() -> None:
    ground = _Ground(replace(_CONFIG, gate=replace(_CONFIG.gate, fence_max_m=(90.0, 80.0, 5.0))))
    ground.autopilot.parameters["RTL_RETURN_ALT"] = 6.0
    (line,) = await ground.engagement.parameter_problems()
    assert line.startswith("parameter RTL_RETURN_ALT is 6")


def test_an_armed_vehicle_has_passed_its_arming_checks() -> None:
    assert _Ground().changed(can_arm=False, armed=True) == []
