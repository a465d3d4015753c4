"""The terminal: text is shown as it is. Names of files, topics and robots may hold anything; none of it is markup."""

from __future__ import annotations

import rich.console
from rich.progress import BarColumn, ProgressColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn

Group = rich.console.Group
Renderable = rich.console.RenderableType


class Console(rich.console.Console):
    """Rich's, without markup, emoji codes and guessed colours in what is printed."""

    def __init__(self, *, stderr: bool = False, width: int | None = None) -> None:
        super().__init__(stderr=stderr, width=width, markup=False, emoji=False, highlight=False)


def wide_console(pipe_columns: int) -> Console:
    """Standard output. A pipe or a file has no width of its own: `pipe_columns` there, as 80 would cut tables."""
    console = Console()
    return console if console.is_terminal else Console(width=pipe_columns)


def bar_columns() -> tuple[ProgressColumn, ...]:
    """Of a progress bar: rich's own, but for its text, which is no markup."""
    return (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
