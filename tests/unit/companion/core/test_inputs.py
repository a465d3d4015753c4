"""Of several events in one tick the worst counts: what loses the vehicle before what loses the target, before news."""

from __future__ import annotations

from companion.core.inputs import Event

_ORDER = list(Event)


def test_what_takes_the_vehicle_from_us_comes_before_all_else() -> None:
    assert _ORDER[:5] == [Event.TASK_FAILED, Event.MODE_LOST, Event.STALLED, Event.LINK_LOST, Event.ABORT]


def test_a_worse_form_of_a_loss_comes_before_the_milder_one() -> None:
    assert _ORDER.index(Event.POSE_LOST) < _ORDER.index(Event.POSE_STALE)
    assert _ORDER.index(Event.BEARING_STALE) < _ORDER.index(Event.BEARING_BACK) < _ORDER.index(Event.BEARING)
    assert _ORDER.index(Event.OFFBOARD_REFUSED) < _ORDER.index(Event.OFFBOARD_CONFIRMED)


def test_a_person_who_asks_to_fly_comes_last() -> None:
    assert _ORDER[-2:] == [Event.RETARGET, Event.ENGAGE]
