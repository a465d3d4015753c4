"""The console that commands print to."""

from __future__ import annotations

from rich.console import Console


def wide_console(pipe_columns: int) -> Console:
    """Standard output. A pipe or a file has no width of its own: `pipe_columns` there, as 80 would cut tables."""
    console = Console()
    return console if console.is_terminal else Console(width=pipe_columns)
