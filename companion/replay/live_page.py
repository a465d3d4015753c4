"""A replay on the page of a service: the same process shows it, fed by the same messages as they are decided again.

The page begins to move when somebody opens it, or after a while without a viewer. At the end it says so and stays as
long as its caller wants.
"""

from __future__ import annotations

import contextlib
import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Final

import msgspec

from companion.core.clock import NS_PER_S
from companion.core.streams import HEALTH
from companion.errors import CompanionError
from companion.host.child import tied
from companion.log.feed import END_OF_LOG, PERIOD_S, STATUS, Feed, introduction
from companion.log.reader import LoggedMessage, Session
from companion.replay.player import Player
from companion.replay.result import Replay, ReplayResult

_HOST: Final = "127.0.0.1"
_PAGE: Final = "companion.page.server"
_START_S: Final = 60.0
_PATIENCE_S: Final = 10.0  # the replay begins when the page is opened, or without a viewer after so long
_LINGER_S: Final = 1.0  # for viewers to see the end
_STATUS_NS: Final = NS_PER_S
_LONGEST_WAIT_S: Final = 60.0


class LivePage:
    """The page's process, as a context; `url` is where it is. Raises CompanionError when the port is taken."""

    def __init__(self, about: dict[str, Any], port: int) -> None:
        self.feed = Feed(about)
        self._port = port
        self._seen = threading.Event()

    def __enter__(self) -> LivePage:
        settings = msgspec.json.encode({"address": _HOST, "port": self._port}).decode()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                tied(sys.executable, "-m", _PAGE, settings),
                stdin=theirs.fileno(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        line = self._process.stdout.readline()
        if not line:
            ours.close()
            why = self._process.stderr.read().strip().splitlines()
            self._end()
            raise CompanionError(f"--port {self._port}: {why[-1] if why else 'the page did not start'}")
        self.url = str(json.loads(line)["listening"])
        self.feed.attach(ours)
        self.feed.start()
        threading.Thread(target=self._listen, name="page", daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.feed.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_LINGER_S)
        self._end()

    def _end(self) -> None:
        self._process.kill()
        self._process.wait()
        for stream in (self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()

    @property
    def pid(self) -> int:
        """Of the page's process."""
        return self._process.pid

    def wait_for_viewer(self) -> None:
        self._seen.wait(_PATIENCE_S)

    def end(self, t_ns: int) -> None:
        """Whoever looks is told that this was all."""
        self.feed.tell(END_OF_LOG, t_ns, True)
        time.sleep(_LINGER_S)

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with contextlib.suppress(ValueError):  # closed meanwhile
            if self._process.stdout.readline():
                self._seen.set()


def replay_with_page(
    player: Player,
    session: Session,
    speed: float | None,
    port: int,
    *,
    announce: Callable[[str], None],
    stay: Callable[[], None] = lambda: None,
) -> ReplayResult:
    """Replays while a page shows it; `announce` is told its address, `stay` returns when the page may go. Raises
    CompanionError when the port is taken."""
    about = introduction(player.config, session.paths[0].name)
    with LivePage(about, port) as page:
        announce(page.url)
        page.wait_for_viewer()
        player.log.also = page.feed.note
        replay = Replay(player, session, on_health=lambda message: _note_health(page.feed, session, message))
        _drive(replay, player, page.feed, speed)
        result = replay.result()
        page.end(result.start_ns + round(result.flight_s * NS_PER_S))
        stay()
    return result


def _drive(replay: Replay, player: Player, feed: Feed, speed: float | None) -> None:
    begun_s, first_ns, told_ns = time.monotonic(), None, 0
    for event in replay.events():
        if first_ns is None:
            first_ns = event.t_ns
        if event.t_ns - told_ns >= _STATUS_NS:
            told_ns = event.t_ns
            feed.tell(STATUS, event.t_ns, player.uav.flight.status())
        if speed is not None:
            wait_s = begun_s + (event.t_ns - first_ns) / NS_PER_S / speed - time.monotonic()
            if wait_s > _LONGEST_WAIT_S:  # a time that jumped: the rest is paced from there
                first_ns, begun_s, wait_s = event.t_ns, time.monotonic(), 0.0
            if wait_s > 0:
                time.sleep(wait_s)
    time.sleep(2 * PERIOD_S)  # the feed's thread has told all that was decided


def _note_health(feed: Feed, session: Session, message: LoggedMessage) -> None:
    """The health of then: a replay has no card and no disk to tell of."""
    health = msgspec.json.decode(message.data)
    feed.note(HEALTH, message.log_time_ns - session.wall_minus_mono_ns, health)
