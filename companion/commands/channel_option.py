"""The check of `--channel`: `wsr.channel` knows which channels there are."""

from __future__ import annotations

import click

from wsr.channel import channel_frequency_hz


def known_channel(ctx: click.Context, param: click.Parameter, value: int | None) -> int | None:
    """A callback of the option. Raises BadParameter for what is no channel of the 5 GHz band."""
    if value is not None:
        try:
            channel_frequency_hz(value)
        except ValueError as error:
            raise click.BadParameter(str(error), ctx, param) from None
    return value
