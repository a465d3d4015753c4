"""What is gathered of a flight in one pass over its log."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from companion.core.inputs import Event, Wish
from companion.core.messages import FlightMode, VehicleState
from companion.core.streams import GATE, LOG, MISSION, VEHICLE, WISH, Stream
from companion.flight.records import SERVICE_ENDS, GateReport, MissionStep
from companion.log.lines import LogLine
from companion.log.reader import open_session
from companion.log.writer import LogWriter
from companion.mission.table import State
from companion.report.content import EventLine, FlightContent, gather
from tests.golden.golden_logs import GOLDEN

_S = 10**9
_BEGIN_S = 1_700_000_000
_VEHICLE = VehicleState(t_mono_ns=0, p_local_enu_m=(0.0, 0.0, 1.0))


def _gathered(folder: Path, messages: Sequence[tuple[float, Stream, Any]]) -> FlightContent:
    """Of a log with these messages at these seconds, in the configuration of the golden flight."""
    metadata = dict(open_session(GOLDEN[0]).metadata) | {"wall_minus_mono_ns": "0"}
    with (folder / "log.mcap").open("wb") as file:
        writer = LogWriter(file, metadata)
        for number, (t_s, stream, message) in enumerate(messages):
            t_ns = round((_BEGIN_S + t_s) * _S)
            writer.write(stream, t_ns, t_ns, number, message=message)
        writer.finish()
    return gather(open_session(folder / "log.mcap"))


def _step(state: State, event: Event, next_state: State, reason: str = "") -> MissionStep:
    return MissionStep(t_mono_ns=0, state=state, event=event, next_state=next_state, actions=(), reason=reason)


def test_what_happened_is_told_with_its_time(tmp_path: Path) -> None:
    content = _gathered(
        tmp_path,
        [
            (0.0, VEHICLE, VehicleState(t_mono_ns=0, mode=FlightMode.HOLD, p_local_enu_m=(1.0, 2.0, 3.0))),
            (0.5, VEHICLE, VehicleState(t_mono_ns=0, mode=FlightMode.HOLD)),
            (1.0, WISH, Wish(t_mono_ns=0, wish=Event.ENGAGE, refusal="no poses")),
            (2.0, WISH, Wish(t_mono_ns=0, wish=Event.ENGAGE, refusal="", target=2)),
            (2.5, MISSION, _step(State.IDLE, Event.ENGAGE, State.PREFLIGHT, "by a person")),
            (3.0, GATE, GateReport(0, ("too fast", "outside"))),
            (3.5, GATE, GateReport(0, ())),
            (4.0, LOG, LogLine(20, "companion", "said")),
            (4.5, LOG, LogLine(30, "companion", "warned")),
            (9.0, MISSION, _step(State.HOLDING, Event.TASK_FAILED, State.FAULT, SERVICE_ENDS)),
        ],
    )
    assert content.events == [
        EventLine(0.0, "vehicle", "mode hold"),
        EventLine(1.0, "wish", "engage, refused: no poses"),
        EventLine(2.0, "wish", f"engage to {content.peer_name(2)}"),
        EventLine(2.5, "mission", "idle -> preflight on engage (by a person)"),
        EventLine(3.0, "gate", "refuses: too fast; outside"),
        EventLine(3.5, "gate", "passes again"),
        EventLine(4.5, "log", "companion: warned"),
        EventLine(9.0, "mission", f"holding -> fault on task_failed ({SERVICE_ENDS})"),
    ]
    assert content.duration_s == pytest.approx(9.0)
    assert content.states == [(2.5, "preflight")], "the service's end is no state of the flight"
    assert (content.vehicle_t_s, content.vehicle_m) == ([0.0], [(1.0, 2.0, 3.0)])
    assert content.is_whole


def test_who_is_flown_to_is_who_was_named_last(tmp_path: Path) -> None:
    content = _gathered(
        tmp_path,
        [
            (0.0, VEHICLE, _VEHICLE),
            (4.0, WISH, Wish(t_mono_ns=0, wish=Event.RETARGET, refusal="", target=7)),
            (9.0, VEHICLE, _VEHICLE),
        ],
    )
    assert (content.target_at(3.9), content.target_at(4.0)) == (content.config.target, 7)
    assert content.peer_name(7) == "7", "of whom the configuration knows nothing"
    assert content.seconds((_BEGIN_S + 4) * _S) == pytest.approx(4.0)


def test_a_message_of_another_century_is_left_out_and_counted(tmp_path: Path) -> None:
    usual = [(0.01 * n, VEHICLE, _VEHICLE) for n in range(200)]
    content = _gathered(tmp_path, [(-1.6e9, VEHICLE, _VEHICLE), *usual])
    assert content.left_out == 1
    assert content.duration_s == pytest.approx(1.99)
    assert len(content.vehicle_m) == 200


def test_the_golden_flight_has_rates_bearings_and_no_truth(content: FlightContent) -> None:
    times, rates = content.rate("/csi")
    assert len(times) == len(rates) == int(content.duration_s)
    assert 100 < rates.mean() < 250
    assert not content.rate("/nothing")[1].any()
    assert content.true_distances() == []
    assert content.true_bearing(content.iterations[0]) is None
    json.dumps([step for _, step in content.steps])
