"""What the command line makes of errors, and of names that hold more than a name."""

from __future__ import annotations

import pytest

from companion.errors import CompanionError, ConfigError, escaped


def test_exit_codes_are_those_that_are_documented() -> None:
    assert CompanionError("x").exit_code == 1
    assert ConfigError("x").exit_code == 2
    assert issubclass(ConfigError, CompanionError)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("flight 3.mcap", "flight 3.mcap"),
        ("Düsseldorf/°", "Düsseldorf/°"),
        ("two\nlines\tand a tab", "two\nlines\tand a tab"),
        ("\x1b[2Jgone", "\\x1b[2Jgone"),
        ("bell\x07 delete\x7f csi\x9b nul\x00", "bell\\x07 delete\\x7f csi\\x9b nul\\x00"),
        ("back\rto the start", "back\\x0dto the start"),
    ],
)
def test_what_would_command_a_terminal_is_shown(text: str, shown: str) -> None:
    assert escaped(text) == shown
