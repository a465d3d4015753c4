"""Options that a mode of a command has no use for: whoever gives one expects something of it, and is told."""

from __future__ import annotations

import click
from click.core import ParameterSource


def refuse_given(mode: str, *names: str) -> None:
    """Raises UsageError for the first of the parameters `names` that stands on the command line beside `mode`."""
    context = click.get_current_context()
    options = {parameter.name: parameter.opts[-1] for parameter in context.command.params}
    for name in names:
        if context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{options[name]} does not go together with {mode}")
