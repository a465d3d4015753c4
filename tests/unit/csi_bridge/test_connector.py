"""The layout of a connector message."""

from __future__ import annotations

import pytest

from csi_bridge.connector import decode_message, encode_message
from csi_bridge.records import CsiError


def test_connector_message_layout() -> None:
    message = encode_message(26, 0xBB, b"body")
    assert message[:4] == (41).to_bytes(4, "little")
    assert message[16:20] == (26).to_bytes(4, "little")
    assert message[36:] == b"\xbbbody"
    assert decode_message(message, 26) == (0xBB, b"body")
    with pytest.raises(CsiError, match="index 26, expected 25"):
        decode_message(message, 25)
