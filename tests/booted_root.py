"""A machine of a test's own, booted by systemd: a clean root as in `tests.clean_root`, in namespaces of its own.

It has no network but loopback, no devices but the harmless ones, and the kernel's settings are read-only to it: nothing
of this machine changes. Its control groups are below one of ours that is removed at the end.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from tests import clean_root
from tests.clean_root import CleanRoot
from tests.paths import ROOT

_SYSTEMD: Final = Path("/lib/systemd/systemd")
_BOOTED_S: Final = 60.0
_BOOT: Final = """
set -e
mount -t tmpfs root "$0"
mkdir "$0/upper" "$0/work" "$0/root"
mount -t overlay overlay -o "lowerdir=/,upperdir=$0/upper,workdir=$0/work" "$0/root"
cd "$0/root"
# What this machine starts by itself is no part of the test.
rm -rf etc/systemd/system/*.wants etc/fstab opt/companion etc/companion etc/systemd/system/companion*
mount -t proc proc proc
mount --bind proc/sys proc/sys
mount -o remount,bind,ro proc/sys
mount -t sysfs -o ro sysfs sys
mount -t tmpfs -o mode=755 dev dev
mkdir dev/pts dev/shm
for one in null zero full random urandom tty; do touch dev/$one; mount --bind /dev/$one dev/$one; done
ln -s /proc/self/fd dev/fd
touch dev/console
mount --bind "$0/console" dev/console
mount -t devpts -o newinstance,ptmxmode=0666 devpts dev/pts
ln -s pts/ptmx dev/ptmx
mount -t tmpfs -o mode=1777 shm dev/shm
mount -t tmpfs -o mode=755 run run
mount -t cgroup2 cgroup2 sys/fs/cgroup
ip link set lo up
mkdir -p mnt
pivot_root . mnt
umount -l /mnt
exec env -i container=lxc PATH=/usr/sbin:/usr/bin:/sbin:/bin /lib/systemd/systemd --system --unit=basic.target
"""


def why_not() -> str:
    """Why nothing can be booted here; empty where it can."""
    if reason := clean_root.why_not():
        return reason
    if not _SYSTEMD.exists() or not shutil.which("nsenter") or not shutil.which("ip"):
        return "no systemd, nsenter or ip here"
    return "" if _control_groups() is not None else "no control groups of version 2 are mounted here"


@contextmanager
def booted_root() -> Iterator[CleanRoot]:
    """Begins in a folder like this repository, as root."""
    groups = _control_groups()
    assert groups is not None
    ours = groups / f"booted-{os.getpid()}"
    ours.mkdir()
    try:
        with tempfile.TemporaryDirectory(prefix="booted-") as folder:
            # Below the tmpfs that the script mounts over the folder nothing is seen: the console is beside it.
            boot = _BOOT.replace("$0/console", f"{folder}.console")
            Path(f"{folder}.console").touch()
            command = ("unshare", "--mount", "--pid", "--uts", "--ipc", "--net", "--cgroup", "--fork", "--kill-child",
                       "--propagation", "private", "sh", "-c", boot, folder)  # fmt: skip
            into = f'echo $$ > "{ours}/cgroup.procs"; exec "$@"'
            with subprocess.Popen(("sh", "-c", into, "sh", *command), stdin=subprocess.DEVNULL) as machine:
                try:
                    with _shell(_first_child(machine.pid)) as root:
                        _until_booted(root)
                        yield root
                finally:
                    machine.kill()
            Path(f"{folder}.console").unlink()
    finally:
        _remove(ours)


@contextmanager
def _shell(pid: int) -> Iterator[CleanRoot]:
    """In the machine whose first process is `pid`."""
    command = ("nsenter", "--target", str(pid), "--mount", "--pid", "--uts", "--ipc", "--net", "--cgroup", "sh")
    environment = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root"}
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True, env=environment
    ) as shell:
        assert shell.stdin is not None and shell.stdout is not None
        shell.stdin.write(f"cd {ROOT}\n")
        yield CleanRoot(shell.stdin, shell.stdout)
        shell.stdin.close()


def _until_booted(root: CleanRoot) -> None:
    said, deadline_s = "", time.monotonic() + _BOOTED_S
    while time.monotonic() < deadline_s:
        said = root.run("systemctl is-system-running || true").strip()
        if said in ("running", "degraded"):
            return
        time.sleep(0.2)
    raise AssertionError(f"not booted after {_BOOTED_S:g} s: {said}")


def _first_child(pid: int) -> int:
    """The process that is number 1 in there, once systemd runs in its root."""
    deadline_s = time.monotonic() + _BOOTED_S
    while time.monotonic() < deadline_s:
        with suppress(OSError):
            for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
                if Path(f"/proc/{child}/comm").read_text() == "systemd\n":
                    return int(child)
        time.sleep(0.05)
    raise AssertionError("systemd does not begin")


def _control_groups() -> Path | None:
    for line in Path("/proc/mounts").read_text().splitlines():
        _, place, kind, *_ = line.split()
        if kind == "cgroup2":
            return Path(place)
    return None


def _remove(group: Path) -> None:
    """All that systemd made below it too, once the last of its processes is gone."""
    for _ in range(100):
        try:
            for folder, _, _ in os.walk(group, topdown=False):
                Path(folder).rmdir()
            return
        except OSError:
            time.sleep(0.05)
