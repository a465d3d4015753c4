"""The events of a log: inputs in their order, each with the time that it came by."""

from __future__ import annotations

from companion.core.streams import CSI, NEIGHBOUR, TICK
from companion.log.reader import LoggedMessage
from companion.replay.player import input_events


def test_an_event_has_its_own_time_and_those_of_its_inputs() -> None:
    apart_ns = 1_000_000
    rows = [(CSI, 500, 485, 7), (CSI, 500, 492, 7), (NEIGHBOUR, 501, 499, 8), (TICK, 502, 502, 9)]
    messages = [
        LoggedMessage(
            topic=stream.topic,
            log_time_ns=log_ns + apart_ns,
            publish_time_ns=own_ns + apart_ns,
            sequence=number,
            data=bytes([number]),
        )
        for stream, log_ns, own_ns, number in rows
    ]
    first, second, third = input_events(messages, apart_ns)
    assert (first.number, first.t_ns, first.own_t_ns) == (7, 500, {CSI.topic: [485, 492]})
    assert first.inputs == {CSI.topic: [b"\x07", b"\x07"]}
    assert (second.t_ns, second.own_t_ns) == (501, {NEIGHBOUR.topic: [499]})
    assert (third.t_ns, third.own_t_ns) == (502, {TICK.topic: [502]})
