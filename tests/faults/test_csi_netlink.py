"""CSI through the real kernel connector. Skipped, with the reason, where this machine does not permit it."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Iterator

import pytest

from csi_bridge.encoder import encode_body
from csi_bridge.netlink import NetlinkFeeder, NetlinkSource
from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, CsiRecord
from csi_bridge.source import CsiSource
from tests.connectors import claimed, needs_netlink
from tests.csi_records import record, same

pytestmark = needs_netlink


@pytest.fixture
def groups() -> Iterator[list[int]]:
    with claimed(2) as indices:
        yield indices


@pytest.fixture
def idx(groups: list[int]) -> int:
    return groups[0]


async def test_records_through_the_kernel_and_the_event_loop(idx: int) -> None:
    source: CsiSource = NetlinkSource(idx, require_kernel_sender=False)
    feeder = NetlinkFeeder(idx)
    received: asyncio.Queue[tuple[int, bytes]] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def take() -> None:
        for item in source.drain():
            received.put_nowait(item)

    loop.add_reader(source.fileno(), take)
    originals = [record(seed=seed, frame_count=seed) for seed in range(200)]
    for original in originals:
        assert feeder.send(CSI_CODE, encode_body(original))
        await asyncio.sleep(0)
    async with asyncio.timeout(5):
        for original in originals:
            parsed = parse_body(*await received.get())
            assert isinstance(parsed, CsiRecord) and same(parsed, original)
    loop.remove_reader(source.fileno())
    feeder.close()
    source.close()


def test_another_process_is_refused_where_the_kernel_is_demanded(idx: int) -> None:
    source = NetlinkSource(idx)
    feeder = NetlinkFeeder(idx)
    for _ in range(3):
        assert feeder.send(CSI_CODE, b"forged")
    assert source.drain() == []
    assert (source.counters.refused_sender, source.counters.datagrams) == (3, 3)
    feeder.close()
    source.close()


def test_other_connector_groups_are_not_heard_and_garbage_is_counted(groups: list[int]) -> None:
    idx, other = groups
    source = NetlinkSource(idx, require_kernel_sender=False)
    feeder = NetlinkFeeder(other)
    feeder.send(CSI_CODE, b"elsewhere")
    with socket.socket(socket.AF_NETLINK, socket.SOCK_DGRAM, 11) as raw:
        raw.bind((0, 0))
        raw.sendto(b"garbage".ljust(60), (0, 1 << (idx - 1)))
    assert source.drain() == []
    assert (source.counters.datagrams, source.counters.malformed) == (1, 1)
    feeder.close()
    source.close()


def test_fault_12_flood_over_the_socket_buffer_goes_on(idx: int) -> None:
    source = NetlinkSource(idx, require_kernel_sender=False, receive_buffer_bytes=64 << 10)
    feeder = NetlinkFeeder(idx)
    body = encode_body(record())
    for _ in range(2000):
        feeder.send(CSI_CODE, body)
    flood = sum(len(batch) for batch in iter(lambda: source.drain(10), []))
    assert 0 < flood < 2000
    assert source.counters.overruns >= 1
    assert feeder.send(CSI_CODE, body)
    assert source.drain() == [(CSI_CODE, body)]
    feeder.close()
    source.close()
