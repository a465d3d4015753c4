"""Errors that the command line shows as one clear line, with the exit code of each.

Exit codes: 0 done, 1 the job failed, 2 usage or configuration.
"""

from __future__ import annotations

import re
from typing import Final

_CONTROL: Final = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")


class CompanionError(Exception):
    """The job failed for a reason a person can act on. The message names the file, record or key and what is right."""

    exit_code = 1


class ConfigError(CompanionError):
    """A configuration or option is wrong; the message lists every error with its key."""

    exit_code = 2


def escaped(text: str) -> str:
    """What a file's or a topic's name holds is shown, and not done by the terminal; ends of lines stay."""
    return _CONTROL.sub(lambda control: f"\\x{ord(control[0]):02x}", text)
