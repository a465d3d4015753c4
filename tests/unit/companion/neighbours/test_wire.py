"""The neighbours' datagram: what goes in comes out, anything else is refused, and it stays small."""

from __future__ import annotations

import hashlib
import hmac
import struct
from dataclasses import replace

import numpy as np
import pytest

from companion.neighbours import wire
from companion.neighbours.bands import coefficients_of
from csi_bridge.feitcsi.rate import Format
from tests import feit_records
from tests.datagrams import KEY, KEYS, datagram
from tests.paths import DOCS
from tests.wire_example import KEY as EXAMPLE_KEY
from tests.wire_example import example
from wsr.reduced import restore_channel


def test_round_trip_keeps_a_tenth_of_a_millimetre_and_every_coefficient() -> None:
    sent = datagram()
    got = wire.decode(wire.encode(sent, KEY), KEYS)
    for name in ("role", "sender", "boot_id", "counter", "sent_ns", "counted"):
        assert getattr(got, name) == getattr(sent, name)
    assert np.abs(got.poses.t_ns - sent.poses.t_ns).max() <= 50_000
    np.testing.assert_allclose(got.poses.p_enu_m, sent.poses.p_enu_m, atol=0.5e-4 + 1e-9)
    np.testing.assert_array_equal(got.poses.confidence, sent.poses.confidence)
    np.testing.assert_array_equal(got.csi.t_ns, sent.csi.t_ns)
    for name in ("frame", "nic_us", "coefficients", "scale", "power_dbm", "antenna"):
        np.testing.assert_array_equal(getattr(got.csi, name), getattr(sent.csi, name), name)
    assert restore_channel(got.csi.coefficients, got.csi.scale).shape == (15, 30)


@pytest.mark.parametrize(("poses", "csi"), [(0, 1), (1, 0), (0, 0), (wire.MAX_POSES, wire.MAX_CSI)])
def test_every_size_fits_one_ethernet_frame(poses: int, csi: int) -> None:
    data = wire.encode(datagram(poses=poses, csi=csi), KEY)
    assert len(data) <= 1472
    got = wire.decode(data, KEYS)
    assert len(got.poses.t_ns) == poses
    assert len(got.csi.frame) == csi


def test_more_than_fits_is_the_callers_mistake() -> None:
    with pytest.raises(ValueError, match="at most"):
        wire.encode(datagram(csi=wire.MAX_CSI + 1), KEY)


def test_any_flipped_bit_is_refused() -> None:
    data = wire.encode(datagram(), KEY)
    for position in range(len(data)):
        forged = bytearray(data)
        forged[position] ^= 1 << position % 8
        with pytest.raises(wire.WireError):
            wire.decode(bytes(forged), KEYS)


def test_a_signed_datagram_of_wrong_length_is_refused() -> None:
    body = wire.encode(datagram(), KEY)[:-16] + b"more"
    with pytest.raises(wire.WireError, match="expected"):
        wire.decode(body + hmac.digest(KEY, body, hashlib.sha256)[:16], KEYS)


def test_another_version_is_named() -> None:
    data = bytearray(wire.encode(datagram(), KEY))
    for version, older in ((9, "update this robot"), (2, "update robot 2")):
        data[4] = version
        with pytest.raises(wire.VersionError, match=f"robot 2 speaks wire version {version}, .*{older}"):
            wire.decode(bytes(data), KEYS)


def test_version_3_is_refused_on_the_air_and_read_from_a_log() -> None:
    """It is the same without bearings."""
    old = bytearray(wire.encode(datagram(), KEY))
    old[4] = 3
    with pytest.raises(wire.VersionError, match="robot 2 speaks wire version 3, this program 4: update robot 2"):
        wire.decode(bytes(old), KEYS)
    assert wire.decode(wire.signed_anew(bytes(old), KEY), KEYS).counter == datagram().counter


DOCUMENT = DOCS / "wire.md"


def documented() -> bytes:
    text = DOCUMENT.read_text(encoding="utf-8").partition("<!-- example -->")[2].partition("<!-- end: example -->")[0]
    lines = [line.split() for line in text.splitlines() if line.strip()]
    assert [int(words[0], 16) for words in lines] == list(range(0, 16 * len(lines), 16))
    return bytes.fromhex("".join("".join(words[1:]) for words in lines))


def test_the_example_is_what_the_code_makes() -> None:
    assert wire.encode(example(), EXAMPLE_KEY) == documented()


def test_the_example_reads_back() -> None:
    got, sent = wire.decode(documented(), [EXAMPLE_KEY]), example()
    np.testing.assert_array_equal(got.csi.coefficients, sent.csi.coefficients)
    np.testing.assert_array_equal(got.csi.nic_us, sent.csi.nic_us)
    np.testing.assert_array_equal(got.csi.t_ns, sent.csi.t_ns)
    np.testing.assert_allclose(got.poses.p_enu_m, sent.poses.p_enu_m, atol=1e-9)
    assert got.echo == sent.echo
    (bearing,), (said,) = got.sightings, sent.sightings
    assert bearing.azimuth_rad == pytest.approx(said.azimuth_rad, abs=1e-4)
    assert replace(bearing, azimuth_rad=said.azimuth_rad, polar_rad=said.polar_rad) == said


def test_a_reader_written_from_the_table_alone_finds_the_same() -> None:
    """Field by field at the documented offsets, with nothing of companion.neighbours.wire."""
    data = documented()
    assert data[:4] == b"WSRN"
    assert (data[4], data[5], struct.unpack_from("<H", data, 6)[0]) == (4, 2, 2)
    assert struct.unpack_from("<QQq", data, 8) == (0x000000071234ABCD, 41, 5_000_000_000)
    assert tuple(data[32:35]) == (2, 2, 3)
    assert struct.unpack_from("<iiiIII", data, 35) == (12500, -5000, 3000, 1000, 4_294_967_000, 10_000)
    assert struct.unpack_from("<HII", data, 59) == (1, 4_900_000, 20_000)
    row = struct.unpack_from("<HHHhHHHHHBB", data, 70)
    assert (data[69], row) == (1, (1, 300, 1800, -(1 << 14), 400, 1 << 14, 65535, 325, 80, 153, 51))
    data, whole = data[:69] + data[90:], data
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
    assert whole[-16:] == hmac.digest(EXAMPLE_KEY, whole[:-16], hashlib.sha256)[:16]


def wide(count: int, width_mhz: int = 80) -> wire.Datagram:
    """With channels of an AX card."""
    band = feit_records.record(Format.HE, width_mhz).rate.layout
    rng = np.random.default_rng(count)
    base = datagram(csi=count)
    coefficients = rng.integers(-31, 32, (count, coefficients_of(band), 2)).astype(np.int8)
    ticks = (4_294_900_000 + np.cumsum(rng.integers(1_800_000, 2_400_000, count))).astype(np.uint32)
    csi = replace(base.csi, frame=np.zeros(count, np.uint32), coefficients=coefficients, band=band, ticks=ticks)
    return replace(base, csi=csi, counted=False)


@pytest.mark.parametrize(("width_mhz", "most"), [(20, 46), (80, 18), (160, 10)])
def test_channels_of_an_ax_card_go_out_in_version_5(width_mhz: int, most: int) -> None:
    sent = wide(most, width_mhz)
    assert sent.csi.band and wire.most_channels(sent.csi.band) == most
    data = wire.encode(sent, KEY)
    assert (data[4], len(data) <= 1400) == (wire.WIDE_VERSION, True)
    got = wire.decode(data, KEYS).csi
    for name in ("coefficients", "scale", "power_dbm", "antenna", "ticks", "band"):
        np.testing.assert_array_equal(getattr(got, name), getattr(sent.csi, name), name)
    # The stamps in microseconds follow from the fine clock.
    assert got.ticks is not None
    steps = np.diff(got.ticks).astype(np.int64) / 320
    assert np.abs(np.diff(got.nic_us).astype(np.int64) - steps).max() <= 1.0


def test_a_band_that_is_none_or_has_no_channels_is_refused() -> None:
    body = bytearray(wire.encode(wide(3), KEY)[:-16])
    for at, value in ((69, 0), (69, 0x3F), (33, 0)):
        changed = bytearray(body)
        changed[at] = value
        with pytest.raises(wire.WireError, match=r"band|channels"):
            wire.decode(wire.signed(bytes(changed), KEY), KEYS)


def test_joined_batches_are_of_the_newest_band() -> None:
    narrow, newer = datagram(csi=4).csi, wide(3).csi
    both = wire.joined([narrow, newer, wire.empty_csi()])
    assert (len(both), both.band) == (3, newer.band)
    assert len(wire.joined([])) == 0
