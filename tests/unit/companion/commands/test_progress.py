"""Progress is for terminals: in a pipe nothing of it is seen, and on a terminal nothing of short work."""

from __future__ import annotations

import io
import time

import pytest
import rich.console

from companion.commands import progress
from companion.commands.progress import tracked_bytes, working


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """What a terminal is sent."""
    out = io.StringIO()

    def console(**options: object) -> rich.console.Console:
        return rich.console.Console(file=out, force_terminal=True, width=80, markup=False)

    monkeypatch.setattr(progress, "Console", console)
    return out


def test_in_a_pipe_it_is_silent(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "_PATIENCE_S", 0.0)
    with tracked_bytes("reading") as update, working("drawing"):
        update(5, 10)
        time.sleep(0.02)
    assert capsys.readouterr() == ("", "")


def test_short_work_shows_no_bar(terminal: io.StringIO) -> None:
    with tracked_bytes("reading") as update:
        update(5, 10)
    assert terminal.getvalue() == ""


def test_work_that_lasts_shows_how_far_it_is(terminal: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "_PATIENCE_S", 0.0)
    monkeypatch.setattr(progress, "_REDRAW_S", 0.0)
    with tracked_bytes("reading [x].mcap") as update:
        deadline_s = time.monotonic() + 30
        while " 50%" not in terminal.getvalue():
            assert time.monotonic() < deadline_s
            update(5, 10)
            time.sleep(0.01)
    assert "reading [x].mcap" in terminal.getvalue()


def test_the_bar_goes_away_when_the_work_fails(terminal: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "_PATIENCE_S", 60.0)
    with pytest.raises(ValueError, match="damaged"), tracked_bytes("reading"):
        raise ValueError("damaged")
    assert terminal.getvalue() == ""
