"""FeitCSI records to bytes: the parser's inverse, and nothing that no card reports."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from csi_bridge.encoder import EncodeError
from csi_bridge.feitcsi.encoder import encode_record
from csi_bridge.feitcsi.parser import parse_record
from csi_bridge.feitcsi.rate import Format, Rate
from csi_bridge.feitcsi.records import FeitRecord
from tests.feit_records import KINDS, rate_word, record, same


@given(
    st.sampled_from(KINDS),
    st.integers(1, 2),
    st.integers(1, 2),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**64 - 1),
    st.binary(min_size=6, max_size=6),
)
@settings(deadline=None, max_examples=40)
def test_encoder_and_parser_are_inverse(
    kind: tuple[Format, int], n_rx: int, n_tx: int, stamp: int, host_us: int, mac: bytes
) -> None:
    changed = replace(record(*kind, n_rx, n_tx), ftm_ticks=stamp, timestamp_low_us=stamp, host_time_us=host_us, mac=mac)
    data = encode_record(changed)
    parsed = parse_record(data)
    assert same(parsed, replace(changed, header=parsed.header))
    assert encode_record(parsed) == data


@pytest.mark.parametrize(
    "broken",
    [
        replace(record(Format.HT, 20), mac=b"short"),
        replace(record(Format.HT, 20), header=b"short"),
        replace(record(Format.HT, 20), rate=Rate(rate_word(Format.HT, 40))),
        replace(record(Format.HT, 20), csi=np.full((56, 2, 1), 0.5, np.complex64)),
        replace(record(Format.HT, 20), csi=np.full((56, 2, 1), 40_000, np.complex64)),
        replace(record(Format.HT, 20), rssi_dbm=(5, -40)),
    ],
)
def test_what_no_card_reports_is_not_written(broken: FeitRecord) -> None:
    with pytest.raises(EncodeError):
        encode_record(broken)
