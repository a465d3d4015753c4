"""The signing relay as a child process between a test's vehicle and a test's library."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import TracebackType

import msgspec

from companion.signing.told import RelayReport, RelaySettings
from tests.signed_link import key_file


class RelayProcess:
    """`vehicle` is the vehicle's socket, `library` stands where MAVSDK's port is; both wait for a second."""

    def __init__(self, directory: Path, url: str = "") -> None:
        self.directory = directory
        self.key = key_file(directory / "mavlink.key")
        self.vehicle, self.library = _bound(), _bound()
        free = _bound()
        self.line = free.getsockname()
        free.close()
        self.settings = RelaySettings(
            url=url or f"udpin://127.0.0.1:{self.line[1]}",
            port=self.library.getsockname()[1],
            key_file=str(directory / "mavlink.key"),
            state_dir=str(directory / "state"),
        )
        self.report = RelayReport()
        self.said = ""
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> RelayProcess:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.end()
        self.vehicle.close()
        self.library.close()

    def start(self) -> None:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "companion.signing.relay", msgspec.json.encode(self.settings).decode()]
        self._process = subprocess.Popen(command, stdin=theirs.fileno())
        theirs.close()
        threading.Thread(target=self._listen, args=(ours,), daemon=True).start()

    def end(self, number: int = signal.SIGTERM) -> None:
        if self._process is not None:
            self._process.send_signal(number)
            self._process.wait(10)
            self._process = None

    def stop(self, seconds: float) -> None:
        """SIGSTOP for so long."""
        assert self._process is not None
        os.kill(self._process.pid, signal.SIGSTOP)
        time.sleep(seconds)
        os.kill(self._process.pid, signal.SIGCONT)

    def cpu_s(self) -> float:
        assert self._process is not None
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def _listen(self, reports: socket.socket) -> None:
        with reports:
            while data := reports.recv(65536):
                told = msgspec.json.decode(data, type=RelayReport | str)
                if isinstance(told, str):
                    self.said = told
                else:
                    self.report = told


def drained(sock: socket.socket) -> list[bytes]:
    """What waits in a socket."""
    found = []
    sock.setblocking(False)
    with contextlib.suppress(BlockingIOError):
        while True:
            found.append(sock.recv(4096))
    sock.settimeout(1.0)
    return found


def _bound() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.bind(("127.0.0.1", 0))
    sock.settimeout(1.0)
    return sock
