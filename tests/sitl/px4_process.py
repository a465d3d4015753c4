"""The mock PX4 as a child process that a test starts, gives orders and asks for its counters."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

from companion.host.unix_datagram import bind_datagram_socket
from companion.sim.px4.report import Px4Report
from tests.sitl import px4_report


class Px4Process:
    """`with Px4Process(port, directory) as px4: px4.order("pilot POSCTL")`. `directory` holds its two sockets."""

    def __init__(self, port: int, directory: Path, *options: str) -> None:
        self._control = directory / "px4.sock"
        self._reply_path = directory / "px4-reply.sock"
        self._command = [sys.executable, "-m", "companion.sim.px4.autopilot", "--connect", f"127.0.0.1:{port}"]
        self._command += ["--control", str(self._control), *options]
        self._process: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None

    def __enter__(self) -> Px4Process:
        self._socket = bind_datagram_socket(self._reply_path)
        self._socket.settimeout(5)
        self._process = subprocess.Popen(self._command)
        self._wait_for_control(time.monotonic() + 10)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        assert self._process is not None and self._socket is not None
        self._process.terminate()
        self._process.wait(10)
        self._socket.close()
        self._reply_path.unlink(missing_ok=True)

    def order(self, text: str) -> Px4Report:
        """Give an order, take the state after it. Raises ValueError when the mock did not understand it."""
        assert self._socket is not None
        self._socket.sendto(text.encode(), str(self._control))
        answer = px4_report.decode(self._socket.recv(65536))
        if answer.error is not None:
            raise ValueError(answer.error)
        return answer

    def report(self) -> Px4Report:
        return self.order("report")

    def wait_until(self, condition: Callable[[Px4Report], bool], timeout_s: float) -> Px4Report:
        """The first report that meets `condition`. Blocks: call it in a thread beside an event loop.

        Raises TimeoutError with the last report.
        """
        deadline_s = time.monotonic() + timeout_s
        while True:
            report = self.report()
            if condition(report):
                return report
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"not met within {timeout_s} s; the last report was {report}")
            time.sleep(0.02)

    def _wait_for_control(self, deadline_s: float) -> None:
        assert self._process is not None
        while not self._control.is_socket():
            if self._process.poll() is not None or time.monotonic() > deadline_s:
                raise RuntimeError(f"the mock did not start: {' '.join(self._command)}")
            time.sleep(0.02)
