"""A process that does not outlive the test that began it, whatever fails there: `subprocess.Popen` waits for its own at
the end of a block, and a test that waits without end is the end of all tests."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any


@contextmanager
def child(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """As `subprocess.Popen`, in text; killed where the block fails."""
    with subprocess.Popen(command, text=True, **options) as process:
        try:
            yield process
        except BaseException:
            process.kill()
            raise
