"""CSI of both cards over a real Unix socket."""

from __future__ import annotations

import socket
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from csi_bridge.connector import encode_message
from csi_bridge.encoder import encode_body
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.records import FEITCSI_CODE
from csi_bridge.records import CSI_CODE
from csi_bridge.source import CsiSource
from csi_bridge.unix_socket import UnixFeeder, UnixSocketError, UnixSource
from tests import csi_records, feit_records


@dataclass(frozen=True)
class Card:
    """The code of its records and the body of the one of a seed."""

    code: int
    body: Callable[[int], bytes]


OLD = Card(CSI_CODE, lambda seed: encode_body(csi_records.record(seed=seed)))
AX = Card(FEITCSI_CODE, lambda seed: encode_record(feit_records.record(seed=seed)))
each_card = pytest.mark.parametrize("card", [OLD, AX], ids=["5300", "AX"])


@each_card
def test_records_arrive_in_order_and_drain_is_limited(tmp_path: Path, card: Card) -> None:
    source: CsiSource = UnixSource(tmp_path / "csi")
    feeder = UnixFeeder(tmp_path / "csi")
    bodies = [card.body(seed) for seed in range(5)]
    assert all(feeder.send(card.code, body) for body in bodies)
    assert source.drain(limit=2) == [(card.code, body) for body in bodies[:2]]
    assert source.drain() == [(card.code, body) for body in bodies[2:]]
    assert source.drain() == []
    assert source.counters.datagrams == 5
    feeder.close()
    source.close()
    assert not (tmp_path / "csi").exists()


@each_card
def test_garbage_is_counted(tmp_path: Path, card: Card) -> None:
    source = UnixSource(tmp_path / "csi")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        for datagram in (b"", b"x" * 36, b"x" * 100, encode_message(26, card.code, b"abc")[:-1]):
            sender.sendto(datagram, str(tmp_path / "csi"))
    assert source.drain() == []
    assert (source.counters.datagrams, source.counters.malformed) == (4, 4)
    source.close()


@each_card
def test_feeder_without_listener_drops(tmp_path: Path, card: Card) -> None:
    feeder = UnixFeeder(tmp_path / "csi")
    assert feeder.send(card.code, b"early") is False
    source = UnixSource(tmp_path / "csi")
    sent = sum(feeder.send(card.code, bytes(500)) for _ in range(100_000))
    assert 0 < sent < 100_000
    assert feeder.dropped == 100_001 - sent
    received = 0
    while batch := source.drain():
        received += len(batch)
    assert received == sent
    source.close()
    feeder.close()


def test_stale_socket_is_taken_over_and_a_live_one_is_not(tmp_path: Path) -> None:
    path = tmp_path / "csi"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as dead:
        dead.bind(str(path))
    source = UnixSource(path)
    with pytest.raises(UnixSocketError, match="in use"):
        UnixSource(path)
    source.close()


def test_unusable_path_is_named(tmp_path: Path) -> None:
    with pytest.raises(UnixSocketError, match="nowhere"):
        UnixSource(tmp_path / "nowhere" / "csi")


def test_records_of_both_cards_come_through_one_socket(tmp_path: Path) -> None:
    source, feeder = UnixSource(tmp_path / "csi"), UnixFeeder(tmp_path / "csi")
    sent = [(card.code, card.body(0)) for card in (OLD, AX)] * 3
    assert all(feeder.send(code, body) for code, body in sent)
    assert source.drain() == sent
    feeder.close()
    source.close()
