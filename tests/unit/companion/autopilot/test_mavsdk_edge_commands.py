"""The edge's commands in virtual time: what is sent, when it is sent again, and what counts as done."""

from __future__ import annotations

import dataclasses

import pytest

from companion.autopilot.mavsdk_edge import MavsdkAutopilot
from companion.autopilot.port import AutopilotError
from companion.core.messages import FlightMode
from tests.manual_clock import ManualClock
from tests.unit.companion.autopilot.virtual_line import VirtualLine, line_of

_TAKEOFF, _SET_MODE, _ARM = 22, 176, 400
_HOLD, _RETURN, _OFFBOARD = (4, 3), (4, 5), (6, 0)


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> VirtualLine:
    return line_of(monkeypatch)


def test_it_is_a_component_of_its_own_system_unless_it_is_told() -> None:
    url, clock = "udpin://127.0.0.1:14540", ManualClock()
    links = [MavsdkAutopilot(url, clock)._link, MavsdkAutopilot(url, clock, is_of_vehicle=True)._link]
    assert [link._is_of_vehicle for link in links] == [False, True]


@pytest.mark.parametrize("command", [_TAKEOFF, _ARM])
def test_a_command_is_sent_again_until_as_many_answers_as_requests_grant_it(line: VirtualLine, command: int) -> None:
    line.answer(command, times=5)  # of others before it
    ask = line.edge._asker(command, (0,))
    for times in (1, 2):
        ask()
        assert len(line.asked(command)) == times, "what is not answered"
    line.answer(command)
    ask()
    assert len(line.asked(command)) == 3, "one answer of two"
    line.answer(command, times=2)
    ask()
    assert len(line.asked(command)) == 3, "all three"
    line.answer(command, result=1)
    ask()
    assert len(line.asked(command)) == 4, "the last one refuses"
    line.answer(command, times=3)
    ask()
    assert len(line.asked(command)) == 4, "more answers than requests"


def test_a_mode_is_granted_by_the_second_answer_to_each_request(line: VirtualLine) -> None:
    """The MAVLink module accepts at once, and the commander answers when it has decided."""
    line.answer(_SET_MODE, times=5)
    ask = line.edge._asker(_SET_MODE, (1, 6, 0))
    for sent, answers in ((1, 0), (2, 1), (3, 2)):
        line.answer(_SET_MODE, times=answers)
        ask()
        assert len(line.asked(_SET_MODE)) == sent
        line.clock.advance(0.1)
        line.tell_mode(_HOLD)
    for answers in (3, 1):  # six in all, and more
        line.answer(_SET_MODE, times=answers)
        ask()
        assert len(line.asked(_SET_MODE)) == 3


def test_a_mode_that_was_told_before_the_request_says_nothing_of_it(line: VirtualLine) -> None:
    line.tell_mode(_HOLD)
    ask = line.edge._asker(_SET_MODE, (1, 6, 0))
    for _ in range(3):
        ask()
    assert len(line.asked(_SET_MODE)) == 1
    line.tell_mode(_HOLD)
    ask()
    assert len(line.asked(_SET_MODE)) == 1, "of the moment in which it was sent"


@pytest.mark.parametrize("before_s", [0.0, 0.1])
async def test_a_mode_that_was_told_before_is_no_confirmation(line: VirtualLine, before_s: float) -> None:
    line.px4.link.vanish()
    line.tell_mode(_HOLD)
    line.clock.advance(before_s)
    with pytest.raises(AutopilotError, match=r"mode hold: not confirmed by telemetry; .* was nothing"):
        await line.edge.hold()


async def test_the_mode_it_is_in_is_not_the_one_that_is_wanted(line: VirtualLine) -> None:
    line.px4.link.vanish()
    line.every = lambda: line.tell_mode(_OFFBOARD)
    line.every()
    with pytest.raises(AutopilotError, match="mode hold: not confirmed by telemetry; mode is offboard"):
        await line.edge.hold()


@pytest.mark.parametrize(("mode", "is_left"), [(_OFFBOARD, True), (_HOLD, False), (_RETURN, False)])
async def test_hold_is_asked_for_on_the_way_out_of_offboard_alone(
    line: VirtualLine, mode: tuple[int, int], is_left: bool
) -> None:
    line.px4.link.vanish()
    line.every = lambda: line.tell_mode(mode)
    line.every()
    with pytest.raises(AutopilotError):
        await line.edge.land()
    modes = [(f["param2"], f["param3"]) for _, _, f in line.told if f.get("command") == _SET_MODE]
    assert ((4, 3) in modes) is is_left and (4, 6) in modes


@pytest.mark.parametrize(
    ("result", "words"), [(0, "accepted"), (2, "denied"), (6, "cancelled"), (7, "7"), (99, "99"), (None, "nothing")]
)
async def test_what_it_answered_last_is_said(line: VirtualLine, result: int | None, words: str) -> None:
    line.px4.link.vanish()
    if result is not None:
        line.every = lambda: line.answer(_SET_MODE, result)
    with pytest.raises(AutopilotError, match=rf"its last answer was {words} \(waited 2\.9 s\)$"):
        await line.edge.hold()


@pytest.mark.parametrize(("poll_s", "waited_s", "times"), [(0.01, 2.9, 6), (0.03, 2.91, 6), (0.5, 3.0, 6)])
async def test_a_command_is_repeated_for_its_time_and_no_longer(
    line: VirtualLine, monkeypatch: pytest.MonkeyPatch, poll_s: float, waited_s: float, times: int
) -> None:
    async def sleep(_: float) -> None:
        line.clock.advance(poll_s)

    monkeypatch.setattr("companion.autopilot.mavsdk_edge.asyncio.sleep", sleep)
    began_ns = line.clock.now_ns()
    with pytest.raises(AutopilotError, match=r"waited 2\.9 s\)$"):
        await line.edge.arm()
    assert line.clock.now_ns() - began_ns == round(waited_s * 1e9) and len(line.asked(_ARM)) == times


async def test_a_takeoff_leaves_place_heading_and_height_to_px4(line: VirtualLine) -> None:
    line.px4.commander.parameters["MIS_TAKEOFF_ALT"] = 2.5
    await line.edge.connect()
    await line.edge.arm()
    await line.edge.takeoff(2.5)
    [fields] = [fields for _, _, fields in line.told if fields.get("command") == _TAKEOFF]
    assert [fields[f"param{i}"] for i in range(1, 8)] == [0, 0, 0, None, None, None, None]
    assert not line.times_s("PARAM_SET"), "it is 2.5 m already"


async def test_a_takeoff_to_half_the_height_that_is_set_sets_it(line: VirtualLine) -> None:
    line.px4.commander.parameters["MIS_TAKEOFF_ALT"] = 3.0
    await line.edge.connect()
    assert not line.edge.is_armed
    await line.edge.arm()
    assert line.edge.is_armed and len(line.asked(_ARM, 1)) == len(line.asked(_ARM)) == 1
    await line.edge.takeoff(1.5)
    assert line.px4.commander.parameters["MIS_TAKEOFF_ALT"] == 1.5


async def test_a_takeoff_that_is_not_taken_up_is_given_up(line: VirtualLine) -> None:
    await line.edge.connect()
    await line.edge.arm()
    line.px4.link.vanish()
    parameters = {"MIS_TAKEOFF_ALT": 1.5, "NAV_MC_ALT_RAD": 0.8}

    def tell() -> None:
        line.tell_mode(_HOLD)
        line.edge._telemetry.parameters.update(parameters)

    line.every = tell
    with pytest.raises(AutopilotError, match=r"takeoff: not confirmed by telemetry; mode is hold"):
        await line.edge.takeoff(1.5)


async def test_taking_off_counts_before_it_is_in_the_air(line: VirtualLine, monkeypatch: pytest.MonkeyPatch) -> None:
    await line.edge.connect()
    await line.edge.arm()
    really = line.edge.state
    monkeypatch.setattr(line.edge, "state", lambda: dataclasses.replace(really(), in_air=False))
    monkeypatch.setattr("companion.autopilot.mavsdk_edge.Climb.hovers", lambda climb, state: True)
    await line.edge.takeoff(1.5)
    assert line.edge.state().mode is FlightMode.TAKEOFF


@pytest.mark.parametrize(("p_m", "height_m"), [(None, 0.0), ((1.0, 2.0, -3.0), -3.0)])
def test_how_high_the_ground_is(
    line: VirtualLine, monkeypatch: pytest.MonkeyPatch, p_m: tuple[float, float, float] | None, height_m: float
) -> None:
    state = dataclasses.replace(line.edge.state(), p_local_enu_m=p_m)
    monkeypatch.setattr(line.edge, "state", lambda: state)
    assert line.edge._height_m() == height_m


async def test_parameters_are_asked_for_by_name_and_written_in_their_own_kind(line: VirtualLine) -> None:
    await line.edge.connect()
    line.told.clear()
    await line.edge.parameter("MIS_TAKEOFF_ALT")
    await line.edge.set_parameter("MIS_TAKEOFF_ALT", 3.5)
    await line.edge.set_parameter("COM_OBL_RC_ACT", 4)
    read, real, whole = (fields for _, _, fields in line.told)
    assert (read["param_id"], read["param_index"]) == ("MIS_TAKEOFF_ALT", -1)
    assert (real["param_type"], whole["param_type"]) == (9, 6)


async def test_a_parameter_that_is_no_number_or_was_not_taken(
    line: VirtualLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    await line.edge.connect()
    line.px4.link.ignore_parameter_requests = True
    parameters = line.edge._telemetry.parameters

    async def sleep(seconds: float) -> None:
        line.run(seconds)
        parameters.update(answers)

    monkeypatch.setattr("companion.autopilot.mavsdk_edge.asyncio.sleep", sleep)
    answers: dict[str, float | None] = {"A": None}
    with pytest.raises(AutopilotError, match="parameter A: its value cannot be read over this library"):
        await line.edge.parameter("A")
    for wanted, answer, is_taken in (
        (2.0, 2.0009, True), (2.0, 2.002, False), (2.0, 1.998, False), (2.0, None, False), (0.0, None, True),
    ):  # fmt: skip
        answers["A"] = answer
        if is_taken:
            await line.edge.set_parameter("A", wanted)
        else:
            with pytest.raises(AutopilotError, match=rf"parameter A: not set to 2; it is {answer} \(waited 2\.9 s\)"):
                await line.edge.set_parameter("A", wanted)


async def test_a_takeoff_that_never_hovers_is_given_up_after_its_time(
    line: VirtualLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    await line.edge.connect()
    await line.edge.arm()
    monkeypatch.setattr("companion.autopilot.mavsdk_edge.Climb.hovers", lambda climb, state: False)
    with pytest.raises(AutopilotError, match=r"takeoff: hovering at 1\.5 m: not seen \(waited 16 s\)"):
        await line.edge.takeoff(1.5)
    [asked_s] = line.asked(_TAKEOFF)
    assert line.now_s - asked_s == pytest.approx(16.0, abs=0.8), "after it is seen to climb"
