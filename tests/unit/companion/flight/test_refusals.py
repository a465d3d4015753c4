"""What the gate says to the stream: when it is recorded, and when it costs a leg."""

from __future__ import annotations

from companion.core.clock import NS_PER_S
from companion.flight.records import GateReport
from companion.flight.refusals import GateRefusals
from companion.safety.gate import Reason
from tests.kept import Kept

_FENCE, _LEAD = (Reason.FENCE_BOX,), (Reason.LEAD,)


def _at(t_s: float) -> int:
    return round(t_s * NS_PER_S)


def test_a_change_of_what_it_says_is_recorded_once() -> None:
    kept = Kept()
    refusals = GateRefusals(kept)
    for t_s, reasons in ((1, ()), (2, _FENCE), (3, _FENCE), (4, _LEAD), (5, ())):
        refusals.note(reasons, _at(t_s), False)
        assert refusals.reasons == reasons
    assert [message for _, _, message in kept.messages] == [
        GateReport(_at(2), _FENCE), GateReport(_at(4), _LEAD), GateReport(_at(5), ())
    ]  # fmt: skip


def test_a_leg_is_given_up_when_it_begins_to_refuse_and_every_five_seconds_of_it() -> None:
    refusals = GateRefusals(Kept())
    given_up = [refusals.note(_FENCE if tick >= 2 else (), _at(tick / 2), False) for tick in range(24)]
    assert [tick for tick, so in enumerate(given_up) if so] == [2, 12, 22]
    assert not refusals.note((), _at(12.0), False)
    assert refusals.note(_FENCE, _at(12.1), False), "it has passed meanwhile"


def test_what_is_excused_costs_nothing_and_is_recorded() -> None:
    kept = Kept()
    refusals = GateRefusals(kept)
    assert not refusals.note(_LEAD, _at(1.0), True)
    assert kept.topics == ["/gate"]
    assert refusals.note(_LEAD, _at(1.1), False), "no leg was given up for it yet"
    assert not refusals.note(_LEAD, _at(1.2), False)
