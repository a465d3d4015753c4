"""The signing relay's process: `python -m companion.signing.relay SETTINGS`, started by the service.

Between the vehicle's line and MAVSDK's port on loopback. Out go signed frames of the library, in come those of the
vehicle that bear the key's signature, unchanged. Nothing older than 0.1 s passes: where this program stood still, what
waited for it is gone. Twice a second it tells on its standard input, a socket, what it has counted.
"""

from __future__ import annotations

import select
import signal
import socket
import sys
import time
from dataclasses import asdict
from pathlib import Path
from types import FrameType
from typing import Final

import msgspec
from pymavlink.dialects.v20 import development as mavlink

from companion.autopilot.port import AutopilotError
from companion.errors import CompanionError
from companion.host.priority import raise_priority
from companion.signing.book import SigningBook
from companion.signing.frames import EPOCH_S, UNITS_PER_S, Counts, Signing
from companion.signing.key import read_signing_key
from companion.signing.lines import OLDEST_S, Line, datagrams, open_line, stamping_socket
from companion.signing.told import RelayReport, RelaySettings

REPORT_S: Final = 0.5
_TURN_S: Final = 0.02
_HELLO_S: Final = 1.0
_SILENT_S: Final = 2.0
_ONBOARD_COMPUTER, _ONBOARD_CONTROLLER = 191, 18


class Relay:
    """Turned by `turn`; its sockets are its own."""

    def __init__(self, line: Line, signing: Signing, port: int, system_id: int) -> None:
        self._line = line
        self._signing = signing
        self._inner = stamping_socket()
        self._inner.bind(("127.0.0.1", 0))
        self._inner.connect(("127.0.0.1", port))  # the kernel drops what others send here
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=_ONBOARD_COMPUTER)
        self._turned_s = self._heard_s = time.monotonic()
        self._said_s = 0.0
        self.old = self.sent = 0
        self.slowest_s = 0.0

    def turn(self, wait_s: float = _TURN_S) -> None:
        """Passes on what has come within `wait_s`."""
        inner, line = self._inner.fileno(), self._line.fileno()
        readable, _, _ = select.select((inner, line), (), (), wait_s)
        now_s = time.monotonic()
        if now_s - self._turned_s > OLDEST_S + wait_s:
            self._line.skip()
            readable = [one for one in readable if one == inner]
        self._turned_s = now_s
        if inner in readable:
            self._pass_out()
        if line in readable:
            self._pass_in()
        self._line.drop_old()
        self._say_hello(now_s)

    def close(self) -> None:
        self._inner.close()
        self._line.close()

    def _pass_out(self) -> None:
        for frame, age_s, _ in datagrams(self._inner):
            arrived_s = time.monotonic() - age_s
            if age_s > OLDEST_S:
                self.old += 1
                continue
            signed = self._signing.sign(frame)
            if signed is not None and self._line.send(signed, arrived_s):
                self.sent += 1
                self.slowest_s = max(self.slowest_s, time.monotonic() - arrived_s)
            elif signed is not None:
                self.old += 1

    def _pass_in(self) -> None:
        for frame, age_s in self._line.receive():
            arrived_s = time.monotonic() - age_s
            if age_s > OLDEST_S:
                self.old += 1
            elif self._signing.takes(frame):
                self._line.trust()
                self._heard_s = time.monotonic()
                try:
                    self._inner.send(frame)
                    self.slowest_s = max(self.slowest_s, self._heard_s - arrived_s)
                except OSError:  # MAVSDK is not there, or does not take it
                    self.old += 1

    def _say_hello(self, now_s: float) -> None:
        """While nothing of the vehicle is taken: a heartbeat, from which it learns where we are and what time it is."""
        if now_s - self._heard_s < _SILENT_S or now_s - self._said_s < _HELLO_S:
            return
        self._said_s = now_s
        heartbeat = self._mav.heartbeat_encode(_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
        signed = self._signing.sign(heartbeat.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        if signed is not None:
            self._line.greet(signed)


def now_units() -> int:
    return round((time.time() - EPOCH_S) * UNITS_PER_S)


def serve(settings: RelaySettings, reports: socket.socket) -> None:
    """Until SIGTERM. Raises CompanionError."""
    key = read_signing_key(Path(settings.key_file))
    book = SigningBook(Path(settings.state_dir))
    ended: list[int] = []

    def end(number: int, frame: FrameType | None) -> None:
        ended.append(number)

    signal.signal(signal.SIGTERM, end)
    signing = Signing(key, book.windows, book.sent, now_units)
    relay = Relay(open_line(settings.url), signing, settings.port, settings.system_id)
    raise_priority()
    book.start(lambda: (signing.sent, signing.windows()))
    told_s = 0.0
    try:
        while not ended:
            relay.turn()
            if time.monotonic() - told_s >= REPORT_S:
                told_s = time.monotonic()
                _tell(reports, _report(signing.counts, relay, book.failed))
                relay.slowest_s = 0.0
    finally:
        relay.close()
        book.close()


def _report(counts: Counts, relay: Relay, book_failed: bool) -> RelayReport:
    return RelayReport(
        **asdict(counts), old=relay.old, sent=relay.sent, slowest_s=relay.slowest_s, book_failed=book_failed
    )


def _tell(reports: socket.socket, report: RelayReport | str) -> None:
    """To a service that may be slow: never waits. One that is gone takes this process with it."""
    try:
        reports.send(msgspec.json.encode(report), socket.MSG_DONTWAIT)
    except BlockingIOError:
        return


def main() -> None:
    settings = msgspec.json.decode(sys.argv[1], type=RelaySettings)
    with socket.socket(fileno=sys.stdin.fileno()) as reports:
        try:
            serve(settings, reports)
        except (CompanionError, AutopilotError) as error:
            _tell(reports, str(error))
            sys.exit(1)


if __name__ == "__main__":
    main()
