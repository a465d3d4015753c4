"""What stands where a file is expected is named, and nothing is waited for."""

from __future__ import annotations

import io
import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from csi_bridge import regular_file
from csi_bridge.regular_file import open_regular, read_regular


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(path))


@pytest.mark.parametrize(
    ("make", "what"),
    [
        (os.mkfifo, "a named pipe, expected a file"),
        (lambda path: path.symlink_to("/dev/zero"), "a device, expected a file"),
        (_socket, "a socket, expected a file"),
        (Path.mkdir, "Is a directory"),
        (lambda path: None, "No such file or directory"),
    ],
)
def test_it_is_named(tmp_path: Path, make: Callable[[Path], object], what: str) -> None:
    make(tmp_path / "x")
    with pytest.raises(OSError) as refused:
        open_regular(tmp_path / "x")
    assert refused.value.strerror == what and refused.value.filename == str(tmp_path / "x")


def test_a_file_is_read_and_a_link_to_one_too(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"abc")
    (tmp_path / "y").symlink_to("x")
    assert read_regular(tmp_path / "y") == b"abc" and read_regular(str(tmp_path / "x")) == b"abc"


def test_what_becomes_a_pipe_between_two_looks_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "x")
    modes = iter([stat.S_IFREG])
    monkeypatch.setattr(Path, "stat", lambda self: os.stat_result((next(modes), *[0] * 9)))
    before = len([*Path("/proc/self/fd").iterdir()])
    with pytest.raises(OSError, match="a named pipe"):
        open_regular(tmp_path / "x")
    assert len([*Path("/proc/self/fd").iterdir()]) == before, "it is closed again"


def test_a_file_that_has_nothing_to_give_yet_is_named(tmp_path: Path) -> None:
    """As the kernel's own log is: a regular file that waits, of which a read without waiting gives None."""

    class Waiting(io.FileIO):
        def readall(self) -> bytes:
            return None  # type: ignore[return-value]

        def readinto(self, _: object, /) -> int:
            return None  # type: ignore[return-value]

    path = tmp_path / "waits"
    path.write_bytes(b"x")
    for size in (-1, 10):
        with (
            regular_file._Reader(Waiting(path)) as file,
            pytest.raises(BlockingIOError, match="nothing to read now"),
        ):
            file.read(size)


def test_everything_of_ours_that_reads_a_named_file_does_it_so() -> None:
    """What is left opens what the system or this program itself makes, or writes."""
    root = Path(regular_file.__file__).resolve().parents[1]
    words = ('.open("rb")', ".read_bytes(", ".read_text(", "io.FileIO(", '.open("r")')
    found = {
        str(path.relative_to(root))
        for folder in ("companion", "csi_bridge", "wsr")
        for path in (root / folder).rglob("*.py")
        for line in path.read_text().splitlines()
        if any(word in line for word in words)
    }
    of_the_system = {
        "companion/autopilot/onboard_status.py", "companion/neighbours/link.py", "companion/radio/pinger.py",
        "companion/radio/traffic.py", "companion/radio/checks.py", "csi_bridge/netlink.py",
        "csi_bridge/feitcsi/netlink.py", "companion/radio/preparing.py", "companion/diagnosis/camera.py",
        "companion/diagnosis/card.py", "companion/diagnosis/installation.py", "companion/diagnosis/machine.py",
    }  # fmt: skip
    of_ours = {
        "csi_bridge/regular_file.py",
        "companion/safety/document.py",
        "companion/study/report.py",
        "companion/study/kept.py",
        "companion/shipped/files.py",
        "companion/page/server.py",
        "companion/report/moments.py",
    }
    assert found - of_the_system - of_ours == set()
