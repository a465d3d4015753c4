"""FeitCSI reports over the Unix socket: the suite of that socket, unchanged, with reports instead of 5300 records."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest

from csi_bridge.encoder import encode_body
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.records import FEITCSI_CODE
from csi_bridge.records import CSI_CODE
from csi_bridge.unix_socket import UnixFeeder, UnixSource
from tests import csi_records, feit_records
from tests.unit.csi_bridge import test_unix_socket as suite

TESTS: Final[tuple[Callable[[Path], None], ...]] = (
    suite.test_records_arrive_in_order_and_drain_is_limited,
    suite.test_garbage_is_counted,
    suite.test_feeder_without_listener_drops,
    suite.test_stale_socket_is_taken_over_and_a_live_one_is_not,
    suite.test_unusable_path_is_named,
)


@pytest.mark.parametrize("test", TESTS, ids=lambda test: test.__name__)
def test_conformance(test: Callable[[Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite, "CSI_CODE", FEITCSI_CODE)
    monkeypatch.setattr(suite, "encode_body", encode_record)
    monkeypatch.setattr(suite, "record", feit_records.record)
    test(tmp_path)


def test_records_of_both_cards_come_through_one_socket(tmp_path: Path) -> None:
    source, feeder = UnixSource(tmp_path / "csi"), UnixFeeder(tmp_path / "csi")
    sent = [(CSI_CODE, encode_body(csi_records.record())), (FEITCSI_CODE, encode_record(feit_records.record()))] * 3
    assert all(feeder.send(code, body) for code, body in sent)
    assert source.drain() == sent
    feeder.close()
    source.close()
