"""The program's own log lines, recorded into the flight's log."""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass

from companion.core.recorder import Recorder
from companion.core.streams import LOG


@dataclass(frozen=True, slots=True)
class LogLine:
    """One line of the program's own log."""

    level: int
    """As in `logging`."""
    name: str
    text: str


def record_lines(recorder: Recorder) -> logging.Handler:
    """Every line of `logging` from now on; the handler, for whoever ends it."""
    handler = _RecordingHandler(recorder)
    logging.getLogger().addHandler(handler)
    return handler


class _RecordingHandler(logging.Handler):
    def __init__(self, recorder: Recorder) -> None:
        super().__init__(logging.INFO)
        self._recorder = recorder

    def emit(self, record: logging.LogRecord) -> None:
        line = LogLine(record.levelno, record.name, record.getMessage())
        self._recorder.record(LOG, time.monotonic_ns(), line)
