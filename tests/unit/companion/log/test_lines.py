"""The program's own log lines go into the flight's log."""

from __future__ import annotations

import logging

import pytest

from companion.core.streams import LOG
from companion.log.lines import LogLine, record_lines
from tests.kept import Kept


def test_lines_from_info_on_are_kept_with_their_words_until_the_handler_is_taken_away() -> None:
    kept, log = Kept(), logging.getLogger("companion.flight.loop")
    handler = record_lines(kept)
    before = log.level
    log.setLevel(logging.DEBUG)
    try:
        log.debug("not this")
        log.info("poses from %s", "t265")
        log.warning("100 % and no arguments")
    finally:
        log.setLevel(before)
        logging.getLogger().removeHandler(handler)
    log.warning("after the end")
    assert {stream for stream, _, _ in kept.messages} == {LOG}
    assert [line for _, _, line in kept.messages] == [
        LogLine(logging.INFO, "companion.flight.loop", "poses from t265"),
        LogLine(logging.WARNING, "companion.flight.loop", "100 % and no arguments"),
    ]


def test_a_line_that_cannot_be_made_costs_only_itself(capsys: pytest.CaptureFixture[str]) -> None:
    kept, log = Kept(), logging.getLogger("companion.odd")
    handler = record_lines(kept)
    try:
        with pytest.raises(TypeError):
            handler.emit(logging.LogRecord("x", logging.INFO, "", 0, "%d metres", ("four",), None))
        log.warning("goes on")
    finally:
        logging.getLogger().removeHandler(handler)
    assert [line.text for _, _, line in kept.messages] == ["goes on"]
