"""The edge's connection in virtual time: opened, watched, lost and opened again, and what is asked of a vehicle."""

from __future__ import annotations

import asyncio
import itertools
import logging
from typing import Any

import pytest

from companion.autopilot.port import AutopilotError
from companion.core.clock import NS_PER_S
from tests.unit.companion.autopilot.virtual_line import VirtualLine, line_of, nothing

_REQUEST_MESSAGE, _SET_INTERVAL, _PREARM = 512, 511, 401
_HEARTBEAT, _VERSION = 0, 148


class _EnoughError(Exception):
    """Ends `MavsdkAutopilot.run`, which has no other end."""


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> VirtualLine:
    return line_of(monkeypatch)


async def test_a_connection_stands_once_a_heartbeat_is_heard(line: VirtualLine) -> None:
    assert line.edge.problem == "not connected yet" and line.edge.state().system_id is None
    await line.edge.connect()
    assert line.edge.problem == "" and line.edge.state().system_id == 1
    assert line.opened == [(6844.0, 10.0)] and line.closed == 0
    assert line.now_s < 6845.1
    assert len(line.asked(_SET_INTERVAL)) == 9
    for message in (_HEARTBEAT, _VERSION):
        assert line.asked(_REQUEST_MESSAGE, message) == [6844.0], "at once"
    commands = [fields for _, name, fields in line.told if name == "COMMAND_LONG"]
    assert all(fields["confirmation"] == 0 and fields["param7"] == 0 for fields in commands)


@pytest.mark.parametrize("limit_s", [None, 3.0])
async def test_a_vehicle_without_a_heartbeat_is_given_up_and_the_link_closed(
    line: VirtualLine, limit_s: float | None
) -> None:
    line.run(1.2)
    line.px4.link.vanish()
    line.tell_mode((4, 3))
    assert line.edge.state().heartbeat_mono_ns == line.clock.now_ns(), "one from before the opening does not count"
    began_s, waited_s = line.now_s, limit_s or 10.0
    with pytest.raises(AutopilotError, match=rf"^the first heartbeat: not seen \(waited {waited_s:g} s\)$"):
        await (line.edge.connect() if limit_s is None else line.edge.connect(limit_s))
    assert line.now_s - began_s == pytest.approx(waited_s, abs=0.03)
    assert line.closed == 1 and line.edge.problem == "not connected yet"


async def test_what_cannot_be_opened_is_said(line: VirtualLine) -> None:
    line.refuses = [AutopilotError("the port is taken")]
    with pytest.raises(AutopilotError, match="the port is taken"):
        await line.edge.connect(1.0)
    assert line.told == [] and line.edge.problem == "not connected yet"


async def test_it_tries_again_later_and_later_and_warns_once(
    line: VirtualLine, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG, "companion.autopilot.mavsdk_edge")
    line.refuses = [*(AutopilotError(f"no {i}") for i in range(3)), None, AutopilotError("gone"), _EnoughError()]
    problems = _problems_at_openings(line)
    running = asyncio.create_task(line.edge.run())
    await _until(lambda: line.edge.problem == "")
    assert [timeout_s for _, timeout_s in line.opened] == [5.0] * 4
    assert _gaps(at_s for at_s, _ in line.opened) == pytest.approx([0.5, 1.0, 2.0], abs=0.011)
    line.px4.link.vanish()
    heard_ns = line.edge.state().heartbeat_mono_ns
    with pytest.raises(_EnoughError):
        await running
    assert heard_ns is not None
    assert line.opened[4][0] - heard_ns / NS_PER_S == pytest.approx(5.0, abs=0.15), "after so long without heartbeats"
    assert line.opened[5][0] - line.opened[4][0] == pytest.approx(0.5, abs=0.011), "from the beginning"
    assert line.closed == 1
    stopped = "autopilot virtual: its heartbeats stopped"
    assert problems == ["not connected yet", "no 0", "no 1", "no 2", stopped, "gone"]
    assert [(record.levelname, record.message) for record in caplog.records] == [
        ("WARNING", "no 0; trying again"),
        ("DEBUG", "no 1; trying again"),
        ("DEBUG", "no 2; trying again"),
        ("INFO", "autopilot virtual: connected to system 1, and to no other from now on"),
        ("WARNING", f"{stopped}; connecting anew"),
        ("WARNING", "gone; trying again"),
    ]


async def test_it_tells_how_this_computer_is_once_a_second_and_of_other_vehicles_once(
    line: VirtualLine, caplog: pytest.LogCaptureFixture
) -> None:
    await line.edge.connect()
    watching = asyncio.create_task(line.edge.watch())
    await _until(lambda: line.now_s > 6850.0)
    told_s = line.times_s("ONBOARD_COMPUTER_STATUS")
    assert told_s[0] < 6845.2, "at once"
    assert _gaps(told_s) == pytest.approx([1.0] * 5, abs=0.11)
    assert caplog.messages == []
    for heard in ({"system 2 (PX4)"}, {"system 2 (PX4)", "system 3 (PX4)"}, set[str]()):
        line.heard = heard
        now_s = line.now_s
        await _until(lambda since_s=now_s: line.now_s > since_s + 2.5)
    assert caplog.messages == [
        f"autopilot virtual: system {n} (PX4) is on the link too and is left alone" for n in (2, 3)
    ]
    line.is_cut = True
    now_s = line.now_s
    await _until(lambda: line.now_s > now_s + 1.5)
    assert not watching.done(), "what cannot be sent shows as heartbeats that stay away"
    watching.cancel()


async def test_a_late_heartbeat_is_asked_for_until_they_have_stayed_away_for_5_s(line: VirtualLine) -> None:
    await line.edge.connect()
    watching = asyncio.create_task(line.edge.watch())
    await _until(lambda: line.now_s > 6848.0)
    asked = len(line.asked(_REQUEST_MESSAGE, _HEARTBEAT))
    assert asked == 1, "that of the beginning: none was late"
    heard_ns = line.edge.state().heartbeat_mono_ns
    assert heard_ns is not None
    line.px4.link.vanish()
    await asyncio.wait_for(watching, 10.0)
    ages_s = [at_s - heard_ns / NS_PER_S for at_s in line.asked(_REQUEST_MESSAGE, _HEARTBEAT)[asked:]]
    assert 1.1 < ages_s[0] <= 1.22 and len(ages_s) == pytest.approx(39, abs=1)
    assert line.now_s - heard_ns / NS_PER_S == pytest.approx(5.05, abs=0.06)


def test_before_anything_is_known_it_asks_for_all_of_it_each_second(line: VirtualLine) -> None:
    line.px4.link.vanish()
    line.pass_by(4.55)
    rounds_s = line.asked(_SET_INTERVAL, 32)
    assert rounds_s == pytest.approx([6844.1, 6845.2, 6846.3, 6847.4, 6848.5], abs=0.01)
    assert line.asked(_SET_INTERVAL) == sorted(9 * rounds_s)
    assert line.asked(_REQUEST_MESSAGE, _VERSION) == rounds_s and line.asked(_PREARM) == []


def test_intervals_are_asked_for_until_each_is_answered(line: VirtualLine) -> None:
    line.edge._ask_again()
    for answered in range(9):
        line.clock.advance(1.1)
        line.edge._ask_again()
        assert len(line.asked(_SET_INTERVAL, 30)) == answered + 2
        line.answer(_SET_INTERVAL, times=answered)
    line.answer(_SET_INTERVAL, times=9)
    asked, versions = len(line.asked(_SET_INTERVAL)), len(line.asked(_REQUEST_MESSAGE, _VERSION))
    line.pass_by(3.35)
    assert len(line.asked(_SET_INTERVAL)) == asked
    assert len(line.asked(_REQUEST_MESSAGE, _VERSION)) == versions + 3, "which alone is not known yet"


def test_only_the_interval_that_differs_is_asked_for_when_it_is_armed(line: VirtualLine) -> None:
    line.edge._ask_again()
    line.told.clear()
    for armed, period_us in ((True, 20_000), (False, 50_000)):
        line.tell_mode((4, 3), armed)
        line.edge._ask_again()
        [(_, _, fields)] = [one for one in line.told if one[2]["command"] == _SET_INTERVAL]
        assert (fields["param1"], fields["param2"]) == (32, period_us)
        assert line.edge._telemetry.acknowledged[_SET_INTERVAL] == 8, "the others were answered before"
        line.told.clear()
        line.edge._ask_again()
        assert line.told == []


def test_why_it_fails_its_checks_is_asked_each_second_until_it_says_so(line: VirtualLine) -> None:
    line.edge._ask_again()
    line.run(1.0)
    line.px4.link.vanish()
    line.edge._ask_again()
    line.answer(_SET_INTERVAL, times=9)
    line.tell("AUTOPILOT_VERSION", flight_sw_version=(1 << 24) | (16 << 16) | (1 << 8) | 255, uid=0, uid2=[0] * 18)
    line.tell("SYS_STATUS", **_FAILS)
    line.told.clear()
    for _ in range(23):
        line.clock.advance(0.1)
        line.tell("SYS_STATUS", **_FAILS)
        line.tell_mode((4, 3), armed=False)
        line.edge._ask_again()
    assert _gaps(line.asked(_PREARM)) == pytest.approx([1.1, 1.1], abs=0.01)
    [fields] = {tuple(sorted(fields.items())) for _, _, fields in line.told if fields["command"] == _PREARM}
    assert all(value == 0 for name, value in fields if name.startswith("param"))


def test_ground_stations_are_told_values_in_the_vehicles_own_time(line: VirtualLine) -> None:
    line.edge.ground.show("speed", 1.5)
    assert line.told[-1][2]["time_boot_ms"] == 0, "not known yet"
    line.edge._ask_again()
    line.run(1.0)
    line.edge.ground.show("speed", 1.5)
    own_ms = line.px4.link.clock.ns(line.clock.now_ns()) / 1e6
    assert line.told[-1][2]["time_boot_ms"] == pytest.approx(own_ms, abs=5)


@pytest.mark.parametrize(
    ("vehicle_ns", "told_ms"),
    [(1_000_000, 1), (1_999_999, 1), (999_999, 0), (-5_000_000, 0), (None, 0), ((1 << 32) * 1_000_000 + 7_000_000, 7),
     ((1 << 32) * 1_000_000 - 1, (1 << 32) - 1)],
)  # fmt: skip
def test_the_vehicles_time_in_32_bits(
    line: VirtualLine, monkeypatch: pytest.MonkeyPatch, vehicle_ns: int | None, told_ms: int
) -> None:
    monkeypatch.setattr(line.edge._telemetry, "vehicle_ns", lambda _: vehicle_ns)
    line.edge.ground.show("speed", None)
    assert line.told[-1][2]["time_boot_ms"] == told_ms


def test_its_question_for_the_time_is_answered_by_its_own(line: VirtualLine, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(line.edge._telemetry, "vehicle_ns", lambda now_ns: now_ns + 5)
    line.edge._answer_time(77)
    [(_, name, fields)] = line.told
    assert (name, fields) == ("TIMESYNC", {"tc1": line.clock.now_ns() + 5, "ts1": 77})
    line.is_cut = True
    line.edge._answer_time(78)
    line.is_cut = False
    monkeypatch.setattr(line.edge._telemetry, "vehicle_ns", lambda _: None)
    line.edge._answer_time(79)
    assert len(line.told) == 1


@pytest.mark.parametrize(("vehicle_ns", "is_sent"), [(None, False), (-1, False), (0, True), (1, True)])
def test_poses_are_sent_in_a_time_that_the_vehicle_has_had(
    line: VirtualLine, monkeypatch: pytest.MonkeyPatch, vehicle_ns: int | None, is_sent: bool
) -> None:
    monkeypatch.setattr(line.edge._telemetry, "vehicle_ns", lambda _: vehicle_ns)
    if is_sent:
        line._send_pose(0.0)
    else:
        with pytest.raises(AutopilotError, match="its own time is not known yet"):
            line._send_pose(0.0)
    assert len(line.told) == is_sent


def _problems_at_openings(line: VirtualLine) -> list[str]:
    problems: list[str] = []
    really = line.open

    async def noted(timeout_s: float) -> None:
        problems.append(line.edge.problem)
        await really(timeout_s)

    line.open = noted  # type: ignore[method-assign]
    return problems


def _gaps(times_s: Any) -> list[float]:
    at_s = list(times_s)
    return [later - earlier for earlier, later in itertools.pairwise(at_s)]


async def _until(is_so: Any) -> None:
    for _ in range(10_000):
        if is_so():
            return
        await asyncio.create_task(nothing())
    raise AssertionError("it never became so")


_CHECKS = 1 << 28
_FAILS = {
    f"onboard_control_sensors_{part}": flags
    for part, flags in (("present", _CHECKS), ("enabled", _CHECKS), ("health", 0))
}
