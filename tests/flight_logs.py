"""Logs of two robots in one flight, made from what the flying one heard in the golden log."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from companion.core.streams import CSI, NEIGHBOUR
from companion.log.exchanges import exchanges_of
from companion.log.reader import Session
from companion.log.repair import copy
from companion.log.writer import LogWriter
from companion.neighbours import wire
from csi_bridge.encoder import encode_body
from tests.csi_records import record
from wsr.reduced import COEFFICIENTS

BEACON: Final = 2
BOOT: Final = (5 << 32) + 1234
_UAV: Final = bytes.fromhex("00216a000001")
_EACH: Final = 20
_KEY: Final = bytes(wire.MIN_KEY_BYTES)


def uav_log(path: Path, session: Session) -> None:
    """The golden flight's log with datagrams of this version in which the beacon says what it heard."""
    exchanges = sorted(_exchanges(session).items())
    with path.open("wb") as file:
        writer = LogWriter(file, session.metadata)
        for message in session.messages():
            if message.topic != NEIGHBOUR.topic:
                copy(writer, message)
        for at in range(0, len(exchanges), _EACH):
            part = exchanges[at : at + _EACH]
            t_ns = part[-1][1]
            writer.write(NEIGHBOUR, t_ns, t_ns, 0, message=_datagram([frame for frame, _ in part], at, t_ns))
        writer.finish()


def deaf_log(path: Path, session: Session) -> None:
    """The golden flight's log without a datagram: nothing was broadcast."""
    with path.open("wb") as file:
        writer = LogWriter(file, session.metadata)
        for message in session.messages():
            if message.topic != NEIGHBOUR.topic:
                copy(writer, message)
        writer.finish()


def beacon_log(
    path: Path,
    session: Session,
    shift_ns: int = 0,
    jitter_ns: Callable[[int], int] = lambda frame: 0,
    is_other_flight: bool = False,
) -> None:
    """The beacon's own: the same exchanges with its card's stamps, on a clock `shift_ns` behind. In another flight the
    counters are the same, and the stamps are not."""
    with path.open("wb") as file:
        writer = LogWriter(file, {"role": "beacon", "name": "ground", "config": "{}"})
        body = encode_body(dataclasses.replace(record(), mac=_UAV))
        for frame, heard_ns in sorted(_exchanges(session).items()):
            t_ns = heard_ns - shift_ns + jitter_ns(frame)
            stamp_us = _stamp_us(frame) + 7_000_001 * is_other_flight
            heard = stamp_us.to_bytes(4, "little") + body[4:34] + frame.to_bytes(4, "little") + body[38:]
            writer.write(CSI, t_ns, t_ns, 0, message=b"\xbb" + heard)
        writer.finish()


def _exchanges(session: Session) -> dict[int, int]:
    """When each was heard, by its frame counter."""
    (heard,) = exchanges_of(session).values()
    return {frame: t_ns for frame, (t_ns, _) in heard.items()}


def _stamp_us(frame: int) -> int:
    return 1_000_000 + 8_333 * frame


def _datagram(frames: list[int], counter: int, t_ns: int) -> bytes:
    count = len(frames)
    csi = wire.CsiBatch(
        frame=np.array(frames, np.uint32),
        t_ns=np.full(count, t_ns, np.int64),
        nic_us=np.array([_stamp_us(frame) for frame in frames], np.uint32),
        coefficients=np.zeros((count, COEFFICIENTS, 2), np.int8),
        scale=np.zeros(count, np.uint8),
        power_dbm=np.zeros(count, np.int8),
        antenna=np.zeros(count, np.uint8),
    )
    none = wire.PoseBatch(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0, np.uint8))
    sent = wire.Datagram(
        role=wire.Role.BEACON, sender=BEACON, boot_id=BOOT, counter=counter, sent_ns=t_ns, poses=none, csi=csi
    )
    return wire.encode(sent, _KEY)
