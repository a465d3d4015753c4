"""What a replay gives as plain values and as a log of its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from companion.core.messages import Setpoint
from companion.core.streams import SETPOINT
from companion.log.encoding import encoded
from companion.log.reader import open_session
from companion.replay.player import Decided
from companion.replay.result import ReplayResult, write_log
from tests.golden.golden_logs import GOLDEN


def _decided(number: int, t_ns: int) -> Decided:
    message = Setpoint(t_ns, None, (0.1 * number, 0.0, 0.0), None)
    data, source = encoded(SETPOINT, t_ns, message)
    return Decided(stream=SETPOINT, t_ns=t_ns, own_t_ns=t_ns - 5, event=number, source=source, data=data)


_RESULT = ReplayResult(
    recorded=[], decided=[_decided(n, 1_000 * n) for n in (1, 2, 3)], events=9, start_ns=1, flight_s=2.0, unexpected=0,
    dropped_while_recording=0, is_cut=False,
)  # fmt: skip


def test_the_digest_is_of_every_decision_and_of_its_event() -> None:
    told = _RESULT.as_json()
    assert told["messages"] == {SETPOINT.topic: 3}
    assert told == replace(_RESULT, recorded=[], start_ns=5).as_json(), "not of the machine or the moment"
    for changed in (
        [*_RESULT.decided[:2], _decided(3, 3_001)],
        [*_RESULT.decided[:2], replace(_RESULT.decided[2], event=4)],
        _RESULT.decided[:2],
    ):
        assert replace(_RESULT, decided=changed).as_json()["sha256"] != told["sha256"]


def test_a_replays_log_holds_what_was_decided_on_the_flights_clock(tmp_path: Path) -> None:
    flight = open_session(GOLDEN[0])
    write_log(tmp_path / "replay.mcap", flight, flight.config(), _RESULT)
    written = open_session(tmp_path / "replay.mcap")
    assert (written.metadata["role"], written.config()) == ("replay", flight.config())
    found = list(written.messages())
    assert [message.data for message in found] == [one.data for one in _RESULT.decided]
    assert [message.sequence for message in found] == [1, 2, 3]
    offset_ns = flight.wall_minus_mono_ns
    assert [(m.log_time_ns - offset_ns, m.publish_time_ns - offset_ns) for m in found] == [
        (1_000, 995), (2_000, 1_995), (3_000, 2_995),
    ]  # fmt: skip
