"""Child processes that never outlive their parent, and leave a Ctrl-C to it.

`python -m companion.host.child PARENT COMMAND...` becomes COMMAND, tied to the process PARENT. A parent that starts its
children so needs no `preexec_fn`, with which Python must copy the whole process (fork) instead of lending it (vfork):
in the service that held up the event loop for 100 ms and more.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from typing import Final

_PR_SET_PDEATHSIG: Final = 1  # prctl(2)
_libc = ctypes.CDLL(None)


def die_with_parent() -> None:
    """For `preexec_fn`: the kernel kills this process when its parent dies, however that happens."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def tied(*command: str) -> tuple[str, ...]:
    """The command line that runs `command` as a child of this process that dies with it. A Ctrl-C is for the parent,
    which ends what it started."""
    return (sys.executable, "-m", "companion.host.child", str(os.getpid()), *command)


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # stays so in what we become
    parent, command = int(sys.argv[1]), sys.argv[2:]
    die_with_parent()
    if os.getppid() != parent:  # it died before we were tied to it
        sys.exit(1)
    try:
        os.execvp(command[0], command)
    except OSError as error:
        sys.exit(f"{command[0]}: {error.strerror}")


if __name__ == "__main__":
    main()
