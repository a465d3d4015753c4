"""docs/wire.md: its example is what the code makes, and an independent reader finds in it what the text says."""

from __future__ import annotations

import hashlib
import hmac
import struct
from pathlib import Path

import numpy as np

from companion import wire

DOCUMENT = Path(__file__).parents[2] / "docs" / "wire.md"
KEY = bytes(range(32))


def documented() -> bytes:
    text = DOCUMENT.read_text(encoding="utf-8").partition("<!-- example -->")[2].partition("<!-- end: example -->")[0]
    lines = [line.split() for line in text.splitlines() if line.strip()]
    assert [int(words[0], 16) for words in lines] == list(range(0, 16 * len(lines), 16))
    return bytes.fromhex("".join("".join(words[1:]) for words in lines))


def example() -> wire.Datagram:
    first = [[31, -31], [0, 1], [-1, 2], [5, -5], [0, 0], [10, -20], [30, -30], [1, 1]]
    second = [[-31, 7], [3, 3], [0, 0], [0, 0], [0, 0], [0, 0], [0, 0], [-2, 2]]
    return wire.Datagram(
        wire.Role.BEACON,
        2,
        7 << 32 | 0x1234ABCD,
        41,
        5_000_000_000,
        wire.PoseBatch(
            np.array([4_980_000_000, 5_000_000_000]),
            np.array([[1.25, -0.5, 0.3], [1.26, -0.5, 0.3002]]),
            np.array([3, 2], np.uint8),
        ),
        wire.CsiBatch(
            np.array([1000, 1001], np.uint32),
            np.array([4_990_000_000, 4_998_200_000]),
            np.array([4_294_967_000, 7904], np.uint32),
            np.array([first, second], np.int8),
            np.array([150, 160], np.uint8),
            np.array([-52, -53], np.int8),
            np.array([0, 2], np.uint8),
        ),
    )


def test_the_example_is_what_the_code_makes() -> None:
    assert wire.encode(example(), KEY) == documented()


def test_the_example_reads_back() -> None:
    got, sent = wire.decode(documented(), [KEY]), example()
    np.testing.assert_array_equal(got.csi.coefficients, sent.csi.coefficients)
    np.testing.assert_array_equal(got.csi.nic_us, sent.csi.nic_us)
    np.testing.assert_array_equal(got.csi.t_ns, sent.csi.t_ns)
    np.testing.assert_allclose(got.poses.p_enu_m, sent.poses.p_enu_m, atol=1e-9)


def test_a_reader_written_from_the_table_alone_finds_the_same() -> None:
    """Field by field at the documented offsets, with nothing of companion.wire."""
    data = documented()
    assert data[:4] == b"WSRN"
    assert (data[4], data[5], struct.unpack_from("<H", data, 6)[0]) == (2, 2, 2)
    assert struct.unpack_from("<QQq", data, 8) == (0x000000071234ABCD, 41, 5_000_000_000)
    assert tuple(data[32:36]) == (2, 2, 1, 0)
    assert struct.unpack_from("<iiiIII", data, 36) == (12500, -5000, 3000, 1000, 4_294_967_000, 10_000)
    assert struct.unpack_from("<Hhhh", data, 68) == (0 << 2 | 2, 100, 0, 2)
    channel = data[60 + 16 + 18 : 60 + 16 + 36]
    stamp = int.from_bytes(channel[1:4], "little")
    assert (channel[0], stamp & (1 << 22) - 1, stamp >> 22, channel[4]) == (1, 8200, 2, 160)
    assert struct.unpack_from("b", channel, 5)[0] == -53
    bits = int.from_bytes(channel[6:18], "little")
    assert [(bits >> 6 * i & 63) - 32 for i in range(16)] == [-31, 7, 3, 3] + [0] * 10 + [-2, 2]
    assert data[-16:] == hmac.digest(KEY, data[:-16], hashlib.sha256)[:16]
    assert len(data) == 60 + 2 * 8 + 2 * 18 + 16
