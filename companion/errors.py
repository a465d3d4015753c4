"""Errors that the command line shows as one clear line, with the exit code of each.

Exit codes: 0 done, 1 the job failed, 2 usage or configuration.
"""

from __future__ import annotations


class CompanionError(Exception):
    """The job failed for a reason a person can act on. The message names the file, record or key and what is right."""

    exit_code = 1


class ConfigError(CompanionError):
    """A configuration or option is wrong; the message lists every error with its key."""

    exit_code = 2
