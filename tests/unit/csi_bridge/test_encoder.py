"""Records to bytes and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from csi_bridge.encoder import EncodeError, encode_body
from csi_bridge.parser import parse_body
from csi_bridge.records import CSI_CODE, CsiRecord
from tests.csi_records import record, same


def test_reads_what_the_encoder_wrote() -> None:
    for layout in (20, 34, 38):
        parsed = parse_body(CSI_CODE, encode_body(record(layout=layout)))
        assert isinstance(parsed, CsiRecord)
        assert same(parsed, record(layout=layout))


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"layout": 21}, "layout 21"),
        ({"n_rx": 2}, "shape"),
        ({"csi": np.full((30, 3, 1), 128, np.complex64)}, "-128..127"),
        ({"csi": np.full((30, 3, 1), 0.5, np.complex64)}, "whole"),
        ({"csi": np.full((30, 3, 1), np.nan, np.complex64)}, "whole"),
        ({"mac": b"short"}, "MAC"),
        ({"frame_count": None}, "frame_count"),
        ({"agc": 256}, "does not fit"),
        ({"frame_count": 1 << 32}, "does not fit"),
    ],
)
def test_encoder_refuses_what_no_card_reports(change: dict[str, object], reason: str) -> None:
    with pytest.raises(EncodeError, match=reason):
        encode_body(replace(record(), **change))  # type: ignore[arg-type]
