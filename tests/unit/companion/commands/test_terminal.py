"""The terminal shows text as it is."""

from __future__ import annotations

import pytest

from companion.commands.terminal import Console, bar_columns, wide_console


def test_neither_markup_nor_emoji_of_a_name_is_done(capsys: pytest.CaptureFixture[str]) -> None:
    Console().print("[red]log[/red] :boom: 3.14")
    assert capsys.readouterr().out == "[red]log[/red] :boom: 3.14\n"


def test_errors_have_a_console_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    Console(stderr=True).print("bad")
    assert capsys.readouterr() == ("", "bad\n")


def test_a_pipe_is_as_wide_as_a_table_needs(capsys: pytest.CaptureFixture[str]) -> None:
    console = wide_console(120)
    assert console.width == 120
    console.print("x" * 110)
    assert capsys.readouterr().out == "x" * 110 + "\n"


def test_the_text_of_a_bar_is_no_markup_either() -> None:
    text, *_ = bar_columns()
    assert getattr(text, "markup", True) is False
