"""Messages of a generic netlink family, and the kernel's own answers."""

from __future__ import annotations

import socket
import struct

import pytest

from csi_bridge.generic_netlink import attribute, attributes, decode_message, encode_message, family_number, is_generic
from csi_bridge.records import CsiError


def test_the_kernels_own_family_is_found_by_name() -> None:
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 16) as opened:
        opened.settimeout(2)
        opened.bind((0, 0))
        assert family_number(opened, "nlctrl") == 0x10
        with pytest.raises(OSError, match="No such file"):
            family_number(opened, "no such family")


def test_a_message_is_read_back() -> None:
    inner = attribute(1, b"abc") + attribute(2, b"", nested=True)
    family, command, data = decode_message(encode_message(0x1F, 7, inner, flags=1))
    assert (family, command) == (0x1F, 7)
    assert [(kind, bytes(value)) for kind, value in attributes(data)] == [(1, b"abc"), (2, b"")]


def test_attributes_are_padded_to_four_bytes() -> None:
    assert attribute(3, b"abcde") == b"\x09\x00\x03\x00abcde\0\0\0"
    assert attribute(3, b"", nested=True) == b"\x04\x00\x03\x80"


@pytest.mark.parametrize("data", [b"\x04\x00\x01", b"\x03\x00\x01\x00", b"\x09\x00\x01\x00abcd"])
def test_an_attribute_that_is_longer_than_what_is_there_is_no_attribute(data: bytes) -> None:
    with pytest.raises(CsiError):
        list(attributes(memoryview(data)))


@pytest.mark.parametrize(
    "datagram",
    [b"", encode_message(0x1F, 7, b"")[:-1], encode_message(3, 7, b""), encode_message(0x1F, 7, b"abcd")[:-1]],
)
def test_anything_but_a_whole_message_of_a_family_is_an_error(datagram: bytes) -> None:
    with pytest.raises(CsiError, match="message of"):
        decode_message(datagram)


def test_messages_of_families_are_told_from_netlinks_own() -> None:
    assert is_generic(encode_message(0x10, 3, b""))
    assert not is_generic(encode_message(3, 3, b""))
    assert not is_generic(b"short")


def test_the_largest_value_of_an_attribute() -> None:
    assert len(attribute(1, bytes(65_531))) == 65_536
    with pytest.raises(struct.error):
        attribute(1, bytes(65_532))
