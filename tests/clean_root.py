"""A root folder of a test's own: this machine's files below, and whatever is written kept in memory and forgotten.

Root alone can have one (mount namespaces, an overlay, chroot). Nothing of this machine's own files and users changes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final

from tests.paths import ROOT

SITE: Final = Path(next(path for path in sys.path if path.endswith("site-packages")))
"""Where this environment's requirements are."""
_SYSTEM_PYTHON: Final = Path("/usr/bin/python3")
_MARK: Final = "--- done:"
_MOUNT: Final = """
set -e
mount -t tmpfs root "$0"
mkdir "$0/upper" "$0/work" "$0/root"
mount -t overlay overlay -o "lowerdir=/,upperdir=$0/upper,workdir=$0/work" "$0/root"
mount -t proc proc "$0/root/proc"
mount --bind /dev "$0/root/dev"
mount -t tmpfs run "$0/root/run"
exec chroot "$0/root" /bin/sh
"""


def why_not() -> str:
    """Why a clean root cannot be had here; empty where it can."""
    if os.getuid() != 0:
        return "only root can have a clean root"
    version = [str(_SYSTEM_PYTHON), "-c", "import ensurepip, sys; print(*sys.version_info[:2])"]
    try:
        found = subprocess.run(version, capture_output=True, text=True, check=True).stdout.split()
    except (OSError, subprocess.CalledProcessError):
        return f"no {_SYSTEM_PYTHON} with venv here"
    if found != [str(part) for part in sys.version_info[:2]]:
        return f"{_SYSTEM_PYTHON} is {'.'.join(found)}, and these requirements are for another one"
    tried = subprocess.run(["unshare", "--mount", "true"], capture_output=True, check=False)
    return "" if tried.returncode == 0 else "mount namespaces are not permitted here"


class CleanRoot:
    """A shell in it. `run` gives what a script printed on both outputs; a failure fails the test."""

    def __init__(self, shell_in: IO[str], shell_out: IO[str]) -> None:
        self._in = shell_in
        self._out = shell_out

    def run(self, script: str, code: int = 0) -> str:
        self._in.write(f"( {script}\n) 2>&1; echo '{_MARK}' $?\n")
        self._in.flush()
        lines: list[str] = []
        while not (line := self._out.readline()).startswith(_MARK):
            assert line, f"the shell has ended:\n{''.join(lines)}"
            lines.append(line)
        text = "".join(lines)
        assert int(line.removeprefix(_MARK)) == code, text
        return text


@contextmanager
def clean_root() -> Iterator[CleanRoot]:
    """Begins in a folder like this repository."""
    with tempfile.TemporaryDirectory(prefix="clean-root-") as folder:
        command = ("unshare", "--mount", "--pid", "--fork", "--kill-child", "--propagation", "private",
                   "sh", "-c", _MOUNT, folder)  # fmt: skip
        environment = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root"}
        pipe = subprocess.PIPE
        with subprocess.Popen(
            command, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True, env=environment
        ) as shell:
            assert shell.stdin is not None and shell.stdout is not None
            root = CleanRoot(shell.stdin, shell.stdout)
            # What a test of another machine's installation would find, here too: nothing.
            root.run(f"cd {ROOT} && rm -rf /opt/companion /etc/companion build")
            shell.stdin.write(f"cd {ROOT}\n")
            yield root
            shell.stdin.close()
