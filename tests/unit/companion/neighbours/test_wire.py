"""The neighbours' datagram: what goes in comes out, anything else is refused, and it stays small."""

from __future__ import annotations

import hashlib
import hmac

import numpy as np
import pytest

from companion.neighbours import wire
from tests.datagrams import KEY, KEYS, datagram
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
