"""Who may engage and how: the RC switch, observe mode, and where the neighbours are known to be."""

from __future__ import annotations

import inspect
import itertools
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest

import companion
from companion.autopilot.port import Autopilot, AutopilotError
from companion.autopilot.reconnect import Backoff
from companion.autopilot.silent import SilentAutopilot
from companion.config.schema import ApertureConfig, MissionConfig
from companion.core.clock import NS_PER_S
from companion.core.inputs import Event
from companion.core.messages import Setpoint, Vector3
from companion.flight.observer import Observer, would_be_setpoint
from companion.flight.rc_switch import RcSwitch
from companion.guidance.approach import Approach, as_velocity, inside
from companion.guidance.targets import Targets
from companion.neighbours.neighbour import Neighbour
from companion.safety.gate import GateLimits
from companion.sensing.records import Bearing

_UP, _DOWN = 1900, 1100


def _switched(*widths_us: int | None) -> list[Event | None]:
    switch = RcSwitch(channel=3, above_us=1700)
    return [switch.update(() if width is None else (1500, 1500, width)) for width in widths_us]


def test_moving_the_switch_up_engages_and_down_aborts() -> None:
    assert _switched(_DOWN, _DOWN, _UP, _UP, _DOWN) == [None, None, Event.ENGAGE, None, Event.ABORT]


def test_a_switch_that_is_up_at_the_start_or_after_rc_was_lost_engages_nothing() -> None:
    assert _switched(_UP, _UP) == [None, None]
    assert _switched(_DOWN, None, _UP, _UP) == [None, None, None, None]
    assert _switched(_DOWN, 65535, _UP) == [None, None, None], "65535 is a channel that is not there"
    assert _switched(_DOWN, 0, _UP) == [None, None, None]


def test_a_channel_the_receiver_does_not_have_is_no_switch() -> None:
    assert RcSwitch(channel=18, above_us=1700).update((1500,) * 8) is None


class _Autopilot:
    """Notes every call."""

    problem = ""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def __getattr__(self, name: str) -> object:
        self.calls.append(name)
        return lambda *_: None


_COMMANDS = ("arm", "takeoff", "request_offboard", "hold", "land", "return_home")


@pytest.mark.parametrize("name", _COMMANDS)
async def test_an_observing_service_cannot_command(name: str) -> None:
    inner = _Autopilot()
    silent = SilentAutopilot(inner)  # type: ignore[arg-type]
    arguments = (1.5,) if name == "takeoff" else ()
    with pytest.raises(AutopilotError, match="was not sent: the service observes"):
        await getattr(silent, name)(*arguments)
    with pytest.raises(AutopilotError, match="a set point was not sent"):
        silent.send_setpoint(Setpoint(0, (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.0))
    assert inner.calls == []


def test_every_command_of_the_port_is_barred_or_harmless() -> None:
    """A method that is added to the port must be thought of here."""
    harmless = {"connect", "run", "problem", "aclose", "state", "take_events", "parameter", "send_odometry"}
    harmless |= {"set_origin"}
    port = {name for name, _ in inspect.getmembers(Autopilot) if not name.startswith("_")}
    assert port == harmless | set(_COMMANDS) | {"send_setpoint"}


def test_a_set_point_has_one_way_out_and_it_leads_through_the_gate() -> None:
    """Read from the source: who else could send one would have to name it."""
    root = Path(companion.__file__).parent
    texts = {path.relative_to(root).as_posix(): path.read_text() for path in root.rglob("*.py")}
    texts = {name: text for name, text in texts.items() if not name.startswith("sim/")}
    assert {name for name, text in texts.items() if ".send_setpoint(" in text} == {
        "flight/loop.py",
        "autopilot/delegating.py",
    }
    flight = texts["flight/loop.py"]
    assert flight.count(".send_setpoint(") == 1 and re.findall(r"self\._send\((.*)\)", flight) == ["verdict.setpoint"]
    messages = re.compile(r"SET_(POSITION|ATTITUDE|ACTUATOR)\w*_TARGET|MANUAL_CONTROL|RC_CHANNELS_OVERRIDE")
    assert {name for name, text in texts.items() if messages.search(text)} == {"autopilot/mavsdk_edge.py"}
    plugins = {plugin for text in texts.values() for plugin in re.findall(r"mavsdk\.plugins\.(\w+)", text)}
    assert plugins == {"mavlink_direct"}, "the library's own offboard plugin repeats the last set point for ever"


_ABOUT_THE_FLIGHT = (
    "course",
    "engagement",
    "knowledge",
    "limits",
    "local_frame",
    "observer",
    "origin",
    "rc_switch",
    "records",
    "status",
    "wishes",
)


def test_what_the_loop_knows_is_asked_and_answers_commands_nothing() -> None:
    """Modules of the room that may name no command of the port, nor start one."""
    folder = Path(companion.__file__).parent / "flight"
    named = re.compile(rf"\.({'|'.join((*_COMMANDS, 'send_setpoint', 'start', 'leave_at_end'))})\(|FlightCommands")
    assert {path.stem for path in folder.glob("*.py") if named.search(path.read_text())} == {"loop", "commands"}
    assert set(_ABOUT_THE_FLIGHT) | {"__init__", "commands", "loop", "vio_forward"} == {
        path.stem for path in folder.glob("*.py")
    }


class _Sar:
    def __init__(self) -> None:
        self.is_measuring = False
        self.is_waiting = False
        self.path_m = 0.0
        self.finished: list[int] = []

    def begin(self) -> None:
        self.is_measuring, self.path_m = True, 0.0

    def finish(self, end_ns: int) -> None:
        self.is_measuring = False
        self.finished.append(end_ns)

    def path_length_m(self) -> float:
        return self.path_m


def test_the_observer_cuts_the_path_of_whoever_moves_the_vehicle() -> None:
    sar = _Sar()
    observer = Observer(sar, ApertureConfig(length_m=1.2, settle_s=0.3))  # type: ignore[arg-type]
    for tick in range(200):  # 0.5 m/s for 10 s: 4 iterations of 1.2 m
        sar.path_m += 0.025
        observer.tick(tick * NS_PER_S // 20)
    assert len(sar.finished) == 3
    sar.finished.clear()
    sar.path_m = -100.0
    for tick in range(200, 650):  # at rest: one every 20 s
        observer.tick(tick * NS_PER_S // 20)
    assert 1 <= len(sar.finished) <= 2


def test_what_would_be_sent_leads_to_the_target_at_flying_height() -> None:
    wanted = would_be_setpoint(5, (1.0, 2.0, 0.3), math.pi / 2, MissionConfig(speed_m_s=0.4), 1.5)
    assert wanted.p_local_enu_m == pytest.approx((1.0, 2.2, 1.5)) and wanted.v_local_enu_m_s == pytest.approx(
        (0, 0.4, 0)
    )


def test_a_failed_connection_waits_longer_each_time_up_to_a_cap() -> None:
    backoff = Backoff()
    levels, waits = [], []
    for _ in range(7):
        levels.append(backoff.level)
        waits.append(backoff.next_s())
    assert waits == [0.5, 1, 2, 4, 8, 8, 8]
    assert levels[0] > levels[1] == levels[-1]


class _Still:
    """A SAR that is never done, so that the approach stays on its leg."""

    is_waiting = True

    def begin(self) -> None:
        pass

    def finish(self, end_ns: int) -> None:
        pass


@pytest.mark.parametrize(("yaw", "ends_at"), [("fixed", 0.3), ("target", 1.8)])
def test_the_nose_is_kept_or_turned_slowly_to_the_target(yaw: str, ends_at: float) -> None:
    approach = Approach(_Still(), MissionConfig(yaw=yaw), 1.2, 0.3)  # type: ignore[arg-type]
    approach.start((0.0, 0.0, 1.5), 0.3)
    yaws = []
    for tick in range(100):
        setpoint = approach.setpoint(tick * NS_PER_S // 20, 1.8, True)
        assert setpoint.yaw_enu_rad is not None
        yaws.append(setpoint.yaw_enu_rad)
    assert yaws[0] == pytest.approx(0.3) and yaws[-1] == pytest.approx(ends_at)
    assert max(abs(b - a) for a, b in itertools.pairwise(yaws)) <= math.radians(30) / 20 + 1e-9


def test_a_velocity_leads_back_to_the_path_within_the_limits() -> None:
    limits = GateLimits((-9, -9, -1), (9, 9, 9), 9.0, max_speed_m_s=1.0, max_climb_m_s=0.5, max_acceleration_m_s2=3.0, min_height_m=0.5)  # fmt: skip # noqa: E501
    path = Setpoint(7, (1.0, 2.0, 1.5), (0.5, 0.0, 0.0), 0.3)
    assert as_velocity(path, (1.0, 2.0, 1.5), limits) == Setpoint(7, None, (0.5, 0.0, 0.0), 0.3)
    back = as_velocity(path, (1.0, 2.5, 1.4), limits)
    assert back.v_local_enu_m_s == pytest.approx((0.5, -0.4, 0.08))
    far = as_velocity(path, (1.0, -50.0, 30.0), limits)
    assert math.hypot(*far.v_local_enu_m_s[:2]) == pytest.approx(1.0) and far.v_local_enu_m_s[2] == -0.5


def test_after_a_refusal_it_stands_inside_the_fence() -> None:
    limits = GateLimits((-9, -4, -1), (9, 4, 5), 6.0, max_speed_m_s=1.0, max_climb_m_s=0.5, max_acceleration_m_s2=3.0, min_height_m=0.5)  # fmt: skip # noqa: E501
    assert inside((1.0, 2.0, 1.5), limits) == pytest.approx((1.0, 2.0, 1.5))
    assert inside((0.0, 5.0, 1.5), limits) == pytest.approx((0.0, 3.7, 1.5))
    assert inside((7.0, 0.0, 1.5), limits) == pytest.approx((5.7, 0.0, 1.5))
    assert inside((0.0, 0.0, 9.0), limits)[2] == pytest.approx(4.7)
    assert inside((0.0, 0.0, 0.1), limits)[2] == pytest.approx(0.8)
    narrow = replace(limits, fence_min_m=(-0.1, -4, -1), fence_max_m=(0.1, 4, 5))
    assert inside((3.0, 1.0, 1.5), narrow) == pytest.approx((0.0, 1.0, 1.5))


def _bearing(from_m: Vector3, target_m: Vector3) -> Bearing:
    dx, dy, dz = (t - f for t, f in zip(target_m, from_m, strict=True))
    polar = math.acos(dz / math.hypot(dx, dy, dz))
    return Bearing(
        t_mono_ns=1,
        p_local_enu_m=from_m,
        azimuth_rad=math.atan2(dy, dx),
        polar_rad=polar,
        azimuth_std_rad=math.radians(1),
        polar_std_rad=math.radians(2),
        target_p_enu_m=(0.0, 0.0, 0.0),
        target_boot=9,
        reliability=0.9,
    )


class _Neighbour(Neighbour):
    """One whose newest pose a test sets."""

    moved_m: Vector3 = (0.0, 0.0, 0.0)
    boot = 9

    def newest_pose(self) -> tuple[int, Vector3] | None:
        return self.boot, self.moved_m


def test_where_a_neighbour_is_known_to_be_follows_what_it_says_of_itself() -> None:
    beacon = _Neighbour(2, "beacon")
    targets = Targets({2: beacon}, target=2)
    assert targets.places() == () and not targets.is_near((0.0, 0.0, 1.5), 100.0)
    for turn in range(8):  # around it
        targets.add(2, _bearing((4.0 + math.cos(turn), math.sin(turn), 1.5), (4.0, 0.0, 0.5)))
    (place,) = targets.places()
    assert place == pytest.approx((4.0, 0.0, 0.5), abs=0.35)
    beacon.moved_m = (1.0, 0.0, 0.0)
    assert targets.places()[0] == pytest.approx((5.0, 0.0, 0.5), abs=0.35)
    assert targets.is_near((4.9, 0.0, 0.6), 2.0) and not targets.is_near((0.0, 0.0, 1.5), 2.0)
    assert targets.is_nearest((0.0, 0.0, 0.0))
    beacon.boot = 10  # it was started again: its frame is another one
    assert targets.places() == ()
    targets.forget()
    assert targets.target is None


def test_one_bearing_tells_no_place() -> None:
    targets = Targets({2: _Neighbour(2, "beacon")}, target=2)
    targets.add(2, _bearing((0.0, 0.0, 1.5), (4.0, 0.0, 0.5)))
    assert targets.places() == () and targets.target is not None and not targets.is_nearest((0.0, 0.0, 0.0))
