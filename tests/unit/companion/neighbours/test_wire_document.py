"""docs/wire.md: its example is what the code makes, and an independent reader finds in it what the text says."""

from __future__ import annotations

import hashlib
import hmac
import struct

import numpy as np

from companion.neighbours import wire
from tests.paths import DOCS
from tests.wire_example import KEY, example

DOCUMENT = DOCS / "wire.md"


def documented() -> bytes:
    text = DOCUMENT.read_text(encoding="utf-8").partition("<!-- example -->")[2].partition("<!-- end: example -->")[0]
    lines = [line.split() for line in text.splitlines() if line.strip()]
    assert [int(words[0], 16) for words in lines] == list(range(0, 16 * len(lines), 16))
    return bytes.fromhex("".join("".join(words[1:]) for words in lines))


def test_the_example_is_what_the_code_makes() -> None:
    assert wire.encode(example(), KEY) == documented()


def test_the_example_reads_back() -> None:
    got, sent = wire.decode(documented(), [KEY]), example()
    np.testing.assert_array_equal(got.csi.coefficients, sent.csi.coefficients)
    np.testing.assert_array_equal(got.csi.nic_us, sent.csi.nic_us)
    np.testing.assert_array_equal(got.csi.t_ns, sent.csi.t_ns)
    np.testing.assert_allclose(got.poses.p_enu_m, sent.poses.p_enu_m, atol=1e-9)
    assert got.echo == sent.echo


def test_a_reader_written_from_the_table_alone_finds_the_same() -> None:
    """Field by field at the documented offsets, with nothing of companion.neighbours.wire."""
    data = documented()
    assert data[:4] == b"WSRN"
    assert (data[4], data[5], struct.unpack_from("<H", data, 6)[0]) == (3, 2, 2)
    assert struct.unpack_from("<QQq", data, 8) == (0x000000071234ABCD, 41, 5_000_000_000)
    assert tuple(data[32:35]) == (2, 2, 1)
    assert struct.unpack_from("<iiiIII", data, 35) == (12500, -5000, 3000, 1000, 4_294_967_000, 10_000)
    assert struct.unpack_from("<HII", data, 59) == (1, 4_900_000, 20_000)
    poses, channels = 2, 2
    columns = [(poses, 14), (poses, 2), *[(poses, 16)] * 3, (channels - 1, 8), (channels - 1, 22)]
    columns += [(channels, 2), (channels, 8), (channels, 8), *[(2 * channels, 6)] * 8]
    head = int.from_bytes(data[69 : 69 + 32], "little")
    rows = int.from_bytes(data[69 + 32 : -16], "little")
    found, used = [], 0
    for count, bits in columns:
        least, width = head % 2**bits, head >> bits & 31
        head >>= bits + 5
        found.append([least + (rows >> used + row * width) % 2**width for row in range(count)])
        used += count * width
    assert (head, rows >> used, len(data)) == (0, 0, 69 + 32 + -(-used // 8) + 16)
    assert found[:5] == [[200, 0], [3, 2], [32768, 32868], [32768, 32768], [32768, 32770]]
    assert found[5:10] == [[1], [8200], [0, 2], [150, 160], [128 - 52, 128 - 53]]
    parts = [[value - 32 for value in column] for column in found[10:]]
    assert parts[:3] == [[31, -31, -31, 7], [0, 1, 3, 3], [-1, 2, 0, 0]]
    assert parts[3:] == [[5, -5, 0, 0], [0] * 4, [10, -20, 0, 0], [30, -30, 0, 0], [1, 1, -2, 2]]
    assert data[-16:] == hmac.digest(KEY, data[:-16], hashlib.sha256)[:16]
