"""What stands behind the service in a replay gives what was recorded, and reaches nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable

import pytest

from companion.autopilot.port import AutopilotError
from companion.core.inputs import CommandOutcome, Event, Reached
from companion.core.messages import Setpoint, VehicleState
from companion.errors import CompanionError
from companion.replay.recorded import (
    REPLAY_KEY,
    RecordedAutopilot,
    RecordedBook,
    RecordedCommands,
    RecordedCsi,
    RecordedInputs,
    RecordedPoses,
    ReplayClock,
)
from tests.manual_clock import ManualClock

_SETPOINT = Setpoint(7, None, (0.1, 0.0, 0.0), None)


async def test_time_is_the_events_and_nobody_waits() -> None:
    clock = ReplayClock(5)
    clock.t_ns = 9
    assert clock.now_ns() == 9
    with pytest.raises(CompanionError, match="a replay never waits"):
        await clock.sleep_until_ns(10)


def test_records_are_given_once_with_the_times_they_came() -> None:
    csi = RecordedCsi()
    csi.add([(1, b"a"), (2, b"b")], [100, None])
    csi.add([(3, b"c")])
    assert csi.gather() == 0
    assert csi.arrivals() == [(1, b"a", 100), (2, b"b", None), (3, b"c", None)]
    assert csi.arrivals() == []
    assert csi.counters.datagrams == 3


def test_set_points_end_here_and_fail_where_they_did_in_flight() -> None:
    autopilot = RecordedAutopilot()
    autopilot.seen = VehicleState(t_mono_ns=7, armed=True)
    assert autopilot.state().armed
    autopilot.send_setpoint(_SETPOINT)
    autopilot.send_failure = "the link is closed"
    with pytest.raises(AutopilotError, match="the link is closed"):
        autopilot.send_setpoint(_SETPOINT)


async def test_nothing_is_commanded() -> None:
    autopilot = RecordedAutopilot()
    commands: list[Awaitable[object]] = [
        autopilot.arm(), autopilot.takeoff(2.0), autopilot.request_offboard(), autopilot.hold(), autopilot.land(),
        autopilot.return_home(), autopilot.run(), autopilot.connect(), autopilot.parameter("COM_OF_LOSS_T"),
    ]  # fmt: skip
    for command in commands:
        with pytest.raises(AutopilotError, match="a replay"):
            await command
    with pytest.raises(CompanionError, match="no pose source"):
        await RecordedPoses().run()


def test_a_command_ends_as_the_log_says() -> None:
    told: list[tuple[Event | None, str]] = []
    commands = RecordedCommands(RecordedAutopilot(), ManualClock(), lambda event, why: told.append((event, why)))

    async def command() -> None:
        raise AssertionError("it is not run")

    commands.start(command(), Event.AIRBORNE, Event.TAKEOFF_FAILED)
    commands.deliver(CommandOutcome(1, Event.AIRBORNE, ""))
    commands.start(command(), Event.AIRBORNE, Event.TAKEOFF_FAILED)
    commands.deliver(CommandOutcome(2, Event.TAKEOFF_FAILED, "not armed"))
    assert told == [(Event.AIRBORNE, ""), (Event.TAKEOFF_FAILED, "not armed")]
    commands.start(command(), Event.LANDED)
    commands.cancel()
    commands.beside(command(), "parameters")
    commands.deliver(CommandOutcome(3, Event.LANDED, ""))
    assert (len(told), commands.unexpected) == (2, 1), "an outcome that nothing had asked for is counted"


def test_inputs_are_these_parts_and_every_key_is_the_replays() -> None:
    inputs = RecordedInputs()
    assert inputs.open_csi() is inputs.csi
    assert inputs.open_book() is inputs.book
    assert inputs.key("anybody") == REPLAY_KEY
    book = RecordedBook()
    book.known = {"2": Reached(5, 100)}
    book.note(2, 6, 200)
    assert (book.reached(2), book.reached(3)) == (Reached(5, 100), None), "as it stood when the service began"
    asyncio.run(_closed(inputs))


async def _closed(inputs: RecordedInputs) -> None:
    for part in (inputs.csi, inputs.poses, inputs.book):
        part.close()
    await RecordedAutopilot().aclose()
