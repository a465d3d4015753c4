"""Exchanges that a log recorded, and whether another robot's log is of the same flight.

Frame counters begin at 1 in every flight: numbers in common prove nothing. What a robot broadcast of an exchange, its
counter with the stamp of its own card, stands in the logs of those who heard it, and the exchange itself in its own.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from companion.config.schema import Config
from companion.core.streams import CSI, NEIGHBOUR
from companion.errors import CompanionError
from companion.log.reader import Session
from companion.neighbours import wire
from csi_bridge.parser import parse_body
from csi_bridge.records import CsiError, CsiRecord

_ENOUGH: Final = 20
_ANY_KEY: Final = bytes(wire.MIN_KEY_BYTES)

Exchanges = dict[bytes, dict[int, tuple[int, int]]]
"""By MAC of the sender and frame counter: arrival [ns wall time] and the card's stamp [us]."""


def exchanges_of(session: Session) -> Exchanges:
    """Those that a robot's own card heard."""
    found: Exchanges = {}
    for message in session.messages({CSI.topic}):
        try:
            record = parse_body(message.data[0], message.data[1:])
        except (CsiError, IndexError):
            continue
        if isinstance(record, CsiRecord) and record.mac is not None and record.frame_count is not None:
            found.setdefault(record.mac, {})[record.frame_count] = message.publish_time_ns, record.timestamp_low_us
    return found


def between(base: Session, other: Session, ours: Exchanges, theirs: Exchanges) -> tuple[Exchanges, Exchanges]:
    """Of both only what they heard of each other, by the MACs in their configurations; all where there is none."""
    try:
        our_config, their_config = base.config(), other.config()
    except CompanionError:
        return ours, theirs
    return _of(ours, our_config, their_config.id), _of(theirs, their_config, our_config.id)


def _of(heard: Exchanges, config: Config, robot: int) -> Exchanges:
    macs = {bytes.fromhex(peer.mac.replace(":", "")) for peer in config.peers if peer.id == robot}
    return {mac: times for mac, times in heard.items() if mac in macs}


def check_identity(base: Session, other: Session, path: Path, theirs: Exchanges) -> None:
    """Raises CompanionError when the log at `path` is of a robot that the first does not know, or of another boot of
    it: of what it broadcast in the first one's flight nothing is in it."""
    robot = _robot_in(base, other, path)
    broadcast = _broadcast(base, robot)
    mine = {(frame, stamp) for heard in theirs.values() for frame, (_, stamp) in heard.items()}
    boots = {boot: len(stamps & mine) for boot, stamps in broadcast.items() if len(stamps) >= _ENOUGH}
    if boots and mine and not any(count >= _ENOUGH for count in boots.values()):
        known = ", ".join(f"{boot >> 32}" for boot in boots)
        raise CompanionError(
            f"{path}: not of this flight: in {base.paths[0]} the robot broadcast {sum(map(len, broadcast.values()))} "
            f"channels (boot {known}), of which {max(boots.values())} are in its own log; expected {_ENOUGH} or more"
        )


def _robot_in(base: Session, other: Session, path: Path) -> int | None:
    """The other robot's id; None where either log holds no configuration. Raises CompanionError where the first does
    not know it by that id, or by another MAC."""
    try:
        ours, theirs = base.config(), other.config()
    except CompanionError:
        return None
    if theirs.id not in {peer.id for peer in ours.peers}:
        known = ", ".join(f"{peer.id} ({peer.name})" for peer in ours.peers)
        raise CompanionError(f"{path}: of robot {theirs.id} ({theirs.name}), which {base.paths[0]} knows not: {known}")
    return theirs.id


def _broadcast(base: Session, robot: int | None) -> dict[int, set[tuple[int, int]]]:
    """(frame counter, card's stamp [us]) of what a robot, or any, said it had heard, by its boot id."""
    found: dict[int, set[tuple[int, int]]] = {}
    for message in base.messages({NEIGHBOUR.topic}):
        # Its signature was good when it was recorded; the key is in no log.
        data = wire.signed_anew(message.data, _ANY_KEY)
        try:
            datagram = wire.decode(data, [_ANY_KEY])
        except wire.WireError:
            continue
        if robot in (None, datagram.sender) and datagram.counted:
            stamps = zip(datagram.csi.frame.tolist(), datagram.csi.nic_us.tolist(), strict=True)
            found.setdefault(datagram.boot_id, set()).update(stamps)
    return found
