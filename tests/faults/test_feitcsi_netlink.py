"""FeitCSI reports through the real kernel's generic netlink. Skipped, with the reason, where it is not permitted.

No kernel here has FeitCSI's driver: another socket stands in for it, and the sender's port tells the two apart.
"""

from __future__ import annotations

import socket

import pytest

from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.message import encode_event
from csi_bridge.feitcsi.netlink import (
    VendorEventFeeder,
    VendorEventSource,
    port_has_listener,
    vendor_events_available,
)
from csi_bridge.feitcsi.parser import parse_record
from csi_bridge.feitcsi.rate import Format
from csi_bridge.feitcsi.records import FEITCSI_CODE, FeitRecord
from csi_bridge.netlink import NetlinkError
from csi_bridge.source import CsiSource, SourceCounters
from tests import feit_records
from tests.faults import test_csi_netlink as suite

IDX = 19
UNAVAILABLE = vendor_events_available(IDX)

pytestmark = pytest.mark.skipif(UNAVAILABLE is not None, reason=f"generic netlink: {UNAVAILABLE}")


def _source(idx: int, require_kernel_sender: bool = True, receive_buffer_bytes: int = 4 << 20) -> VendorEventSource:
    return VendorEventSource(None, require_kernel_sender, receive_buffer_bytes, idx)


def _record(seed: int = 0, frame_count: int = 0) -> FeitRecord:
    """Reports have no counter: the time stamp takes its place."""
    return feit_records.record(seed=seed, stamp_us=frame_count)


def _parse_body(code: int, body: bytes) -> FeitRecord:
    assert code == FEITCSI_CODE
    return parse_record(body)


async def test_the_connectors_suite_unchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    replaced = {
        "NetlinkSource": _source,
        "NetlinkFeeder": VendorEventFeeder,
        "CSI_CODE": FEITCSI_CODE,
        "CsiRecord": FeitRecord,
        "encode_body": encode_record,
        "parse_body": _parse_body,
        "record": _record,
        "same": feit_records.same,
    }
    for name, value in replaced.items():
        monkeypatch.setattr(suite, name, value)
    await suite.test_records_through_the_kernel_and_the_event_loop(IDX)


@pytest.mark.parametrize(("kind", "width_mhz"), [(Format.HT, 20), (Format.HE, 80), (Format.HE, 160)])
def test_reports_of_any_size_come_through_whole(kind: Format, width_mhz: int) -> None:
    source: CsiSource = _source(IDX, require_kernel_sender=False)
    feeder = VendorEventFeeder(IDX)
    body = encode_record(feit_records.record(kind, width_mhz, n_tx=2))
    assert feeder.send(FEITCSI_CODE, body)
    assert source.drain() == [(FEITCSI_CODE, body)]
    feeder.close()
    source.close()


class _Subscribed(VendorEventSource):
    """As if the kernel had taken the subscription."""

    def __init__(self, idx: int) -> None:
        super().__init__(None, False, idx=idx)
        self._kernel_only, self._family = True, 31


def test_another_process_is_refused_where_the_kernel_is_demanded() -> None:
    source, feeder = _Subscribed(IDX), VendorEventFeeder(IDX)
    for _ in range(3):
        assert feeder.send(FEITCSI_CODE, b"forged")
    assert source.drain() == []
    assert (source.counters.refused_sender, source.counters.datagrams) == (3, 3)
    feeder.close()
    source.close()


def test_garbage_is_counted_and_a_flood_is_refused_to_its_sender() -> None:
    source, feeder = _source(IDX, False, 64 << 10), VendorEventFeeder(IDX)
    port_id = 0xFE17_0000 | IDX
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 16) as raw:
        raw.bind((0, 0))
        raw.sendto(b"garbage".ljust(60), (port_id, 0))
        raw.sendto(encode_event(b"", 31).ljust(200, b"\xff"), (port_id, 0))
    assert source.drain() == []
    assert (source.counters.datagrams, source.counters.malformed) == (2, 2)
    body = encode_record(feit_records.record())
    taken = sum(feeder.send(FEITCSI_CODE, body) for _ in range(2000))
    assert 0 < taken < 2000 and feeder.dropped == 2000 - taken
    assert sum(len(batch) for batch in iter(lambda: source.drain(10), [])) == taken
    assert feeder.send(FEITCSI_CODE, body)
    assert source.drain() == [(FEITCSI_CODE, body)]
    feeder.close()
    source.close()


class _Overrun:
    """A socket whose kernel had no room, once."""

    def __init__(self, datagrams: list[bytes]) -> None:
        self._datagrams = datagrams
        self._failed = False

    def recvfrom(self, size: int) -> tuple[bytes, tuple[int, int]]:
        if not self._failed:
            self._failed = True
            raise OSError(105, "No buffer space available")
        if not self._datagrams:
            raise BlockingIOError
        return self._datagrams.pop(0)[:size], (0, 0)


def test_fault_12_an_overrun_is_counted_and_reading_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    source = _Subscribed(IDX)
    body = encode_record(feit_records.record())
    opened = source._socket
    monkeypatch.setattr(source, "_socket", _Overrun([encode_event(body, 31), encode_event(body, 30)]))
    assert source.drain() == [(FEITCSI_CODE, body)]
    assert source.counters == SourceCounters(datagrams=2, malformed=1, overruns=1)
    opened.close()


def test_a_kernel_without_the_driver_says_so() -> None:
    with pytest.raises(NetlinkError, match=r"csi\.interface"):
        VendorEventSource(None)
    with pytest.raises(NetlinkError, match="there is no such interface"):
        VendorEventSource("none0")
    with pytest.raises(NetlinkError, match="lo: asking for its CSI"):
        VendorEventSource("lo")


def test_a_listener_is_seen_and_one_that_is_not_there_is_no_error() -> None:
    feeder = VendorEventFeeder(IDX)
    assert port_has_listener(IDX) is False
    assert feeder.send(FEITCSI_CODE, b"early") is False
    source = _source(IDX, require_kernel_sender=False)
    assert port_has_listener(IDX)
    with pytest.raises(NetlinkError, match="in use by another process"):
        _source(IDX, require_kernel_sender=False)
    source.close()
    feeder.close()
