"""`--channel` takes what `wsr.channel` knows."""

from __future__ import annotations

import click
import pytest

from companion.commands.channel_option import known_channel

_PARAM = click.Option(["--channel"])
_CONTEXT = click.Context(click.Command("x"))


@pytest.mark.parametrize("value", [None, 36, 108, 165])
def test_a_channel_passes_and_none_means_as_the_recording_says(value: int | None) -> None:
    assert known_channel(_CONTEXT, _PARAM, value) == value


@pytest.mark.parametrize("value", [-1, 0, 6, 35, 1000])
def test_what_is_no_channel_is_a_usage_error(value: int) -> None:
    with pytest.raises(click.BadParameter, match=str(value)):
        known_channel(_CONTEXT, _PARAM, value)
