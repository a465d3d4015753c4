"""The packed payload, read as the bits stand."""

from __future__ import annotations

import numpy as np
import pytest

from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, CsiRecord
from tests.unit.csi_bridge.bodies import read_bits, stock_body


@pytest.mark.parametrize(("n_rx", "n_tx", "size"), [(1, 1, 72), (2, 1, 132), (3, 1, 192), (3, 2, 372), (3, 3, 552)])
def test_payload_is_read_as_the_bits_stand(n_rx: int, n_tx: int, size: int) -> None:
    payload = np.random.default_rng(n_rx * 4 + n_tx).bytes(size)
    parsed = parse_body(CSI_CODE, stock_body(n_rx, n_tx, 0b100100, payload))
    assert isinstance(parsed, CsiRecord)
    assert parsed.csi.reshape(-1).tolist() == read_bits(payload, n_rx, n_tx)
    assert (parsed.timestamp_low_us, parsed.bfee_count, parsed.rate) == (123_456_789, 321, 0x1234)
    assert (parsed.rssi, parsed.noise_dbm, parsed.agc) == ((41, 33, 20), -90, 35)
    assert (parsed.layout, parsed.host_time_ns, parsed.mac, parsed.frame_count) == (20, None, None, None)
