"""A progress bar for the terminal, shown once the work has taken longer than a second."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from rich.progress import Progress
from rich.text import Text

from companion.commands.terminal import Console, bar_columns

_PATIENCE_S: Final = 1.0
_REDRAW_S: Final = 0.1


@contextmanager
def working(what: str) -> Iterator[None]:
    """A spinner for work whose length is not known. Silent where there is no terminal."""
    console = Console(stderr=True)
    with console.status(Text(what)) if console.is_terminal else contextlib.nullcontext():
        yield


@contextmanager
def tracked_bytes(what: str) -> Iterator[Callable[[int, int], None]]:
    """Gives a function to call with (done, total), as often as one likes. Silent where there is no terminal."""
    bar = Progress(*bar_columns(), console=Console(stderr=True), transient=True)
    task = bar.add_task(what, total=None)
    shown = time.monotonic()

    def update(done: int, total: int) -> None:
        nonlocal shown
        now = time.monotonic()
        if now - shown < _REDRAW_S:
            return
        shown = now
        bar.update(task, completed=done, total=total)

    # By a timer, not by the first call: what comes before it, or one long piece between two, is work as well.
    timer = threading.Timer(_PATIENCE_S, bar.start)
    timer.daemon = True
    if bar.console.is_terminal:
        timer.start()
    try:
        yield update
    finally:
        timer.cancel()
        if timer.ident is not None:
            timer.join()
        if bar.live.is_started:  # stopping one that never started prints an empty line
            bar.stop()
