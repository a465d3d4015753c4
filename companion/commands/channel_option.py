"""The `--channel` option: `wsr.channel` knows which channels there are."""

from __future__ import annotations

from typing import Any, Final

import click

from wsr.channel import channel_frequency_hz


class _Channel(click.ParamType):
    name = "channel"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        try:
            channel = int(value)
            channel_frequency_hz(channel)
        except ValueError as error:
            said = str(error) if str(error).startswith("channel") else f"{value!r} is no channel number, such as 108"
            self.fail(said, param, ctx)
        return channel


CHANNEL: Final = _Channel()
