"""Datagrams in, neighbours out: each datagram is authenticated, judged and filed with the robot it came from."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from companion.core.clock import Clock
from companion.neighbours import wire
from companion.neighbours.boots import Book
from companion.neighbours.clock_relation import ClockRelation
from companion.neighbours.neighbour import Neighbour
from companion.neighbours.session import Freshness, SenderSession

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class LinkCounters:
    """Datagrams that no neighbour accounts for."""

    malformed: int = 0
    version: int = 0
    """Of another version of this program's format; the newest is named in the log."""
    unknown_sender: int = 0
    own: int = 0


class NeighbourReceiver:
    """Authenticates datagrams and files them with the neighbour they came from.

    `keys` has for each peer every key that is valid. `book` keeps what must outlive a restart; without one, a replay is
    noticed only as long as the service runs. `on_accepted` gets the sender of each datagram that is taken, when it was
    sent and when it arrived, so that the sender can be told.
    """

    def __init__(
        self,
        own_id: int,
        names: Mapping[int, str],
        keys: Mapping[int, Sequence[bytes]],
        clock: Clock,
        *,
        book: Book | None = None,
        we_ping: bool = True,
        on_accepted: Callable[[int, int, int], None] = lambda *_: None,
    ) -> None:
        self._own_id = own_id
        self._keys = keys
        self._clock = clock
        self._book = book
        self.neighbours = {
            peer: Neighbour(peer, name, SenderSession(book.reached(peer) if book else None), ClockRelation(we_ping))
            for peer, name in names.items()
        }
        self.counters = LinkCounters()
        self.authentic = 0
        """Datagrams with a good signature, taken or not."""
        self._on_accepted = on_accepted

    def take(self, data: bytes, arrived_ns: int | None = None) -> bool:
        """Files one datagram that arrived then, or now; False when it was refused (and counted)."""
        try:
            sender = wire.sender_of(data)
        except wire.VersionError as error:
            if not self.counters.version:
                _log.error("%s", error)
            self.counters.version += 1
            return False
        except wire.WireError:
            self.counters.malformed += 1
            return False
        neighbour = self.neighbours.get(sender)
        if neighbour is None:
            if sender == self._own_id:  # a broadcast comes back to its sender
                self.counters.own += 1
            else:
                self.counters.unknown_sender += 1
            return False
        try:
            datagram = wire.decode(data, self._keys[sender])
        except wire.SignatureError:
            neighbour.refused.bad_key += 1
            neighbour.refuse("signed with another key, or forged", self._clock.now_ns())
            return False
        except wire.WireError as error:
            neighbour.refused.malformed += 1
            neighbour.refuse(str(error), self._clock.now_ns())
            return False
        return self._file(neighbour, datagram, self._clock.now_ns() if arrived_ns is None else arrived_ns)

    def _file(self, neighbour: Neighbour, datagram: wire.Datagram, now_ns: int) -> bool:
        self.authentic += 1
        session = neighbour.session
        known, rivals, old_boots = session.boot_id, session.rivals, session.old_boots
        verdict = session.judge(datagram.boot_id, datagram.counter, now_ns)
        if verdict is Freshness.DUPLICATE and rivals is None and session.rivals is not None:
            _log.error(
                "two robots send as %s (id %d): boots %016x and %016x take turns; both are refused",
                neighbour.name, neighbour.id, *session.rivals,
            )  # fmt: skip
            neighbour.received.clear()
        if session.old_boots and not old_boots:
            _log.warning(
                "%s (id %d): boot %016x is older than one that was heard already, so it is refused: replayed, or that "
                "robot has lost its state_dir; then give all robots new keys and remove their boots.json",
                neighbour.name, neighbour.id, datagram.boot_id,
            )  # fmt: skip
        if session.boot_id != known:
            _log.info("%s (id %d): boot %016x", neighbour.name, neighbour.id, session.boot_id)
            neighbour.restart()
        if verdict is not Freshness.FRESH:
            if verdict is Freshness.REPLAY:
                neighbour.refused.replay += 1
            else:
                neighbour.refused.duplicate_identity += 1
            neighbour.refuse(verdict, now_ns)
            return False
        if self._book is not None:
            self._book.note(neighbour.id, datagram.boot_id, datagram.counter)
        if not neighbour.file(datagram, now_ns):
            return False
        if datagram.echo is not None and datagram.echo.robot == self._own_id:
            neighbour.take_echo(datagram.echo, datagram.sent_ns, now_ns)
        self._on_accepted(neighbour.id, datagram.sent_ns, now_ns)
        return True
