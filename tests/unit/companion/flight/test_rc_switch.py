"""The RC switch: which movements of it are a wish, and which are none."""

from __future__ import annotations

from companion.config.schema import AutopilotConfig
from companion.core.inputs import Event
from companion.flight.rc_switch import RcSwitch, configured_switch

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


def test_a_configuration_names_one_or_none() -> None:
    assert configured_switch(AutopilotConfig("udpin://127.0.0.1:1")) is None
    switch = configured_switch(AutopilotConfig("udpin://127.0.0.1:1", engage_rc_channel=1, engage_rc_above_us=1400))
    assert switch is not None
    assert [switch.update((us,)) for us in (1390, 1410)] == [None, Event.ENGAGE]
