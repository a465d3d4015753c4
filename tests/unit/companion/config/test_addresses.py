"""Addresses are taken as they are meant, to the last character."""

from __future__ import annotations

import msgspec
import pytest

from companion.config.addresses import Ipv4, Mac


@pytest.mark.parametrize("text", ["00:21:6A:3F:17:5A", "aa:bb:cc:dd:ee:ff"])
def test_a_cards_address_is_six_pairs(text: str) -> None:
    assert msgspec.convert(text, Mac) == text


@pytest.mark.parametrize("text", ["0.0.0.0", "192.168.1.255"])
def test_a_hosts_address_is_four_numbers(text: str) -> None:
    assert msgspec.convert(text, Ipv4) == text


@pytest.mark.parametrize("text", ["00:21:6A:3F:17:5A\n", "00:21:6A:3F:17", "00-21-6A-3F-17-5A", "g0:21:6A:3F:17:5A"])
def test_another_is_no_cards(text: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(text, Mac)


@pytest.mark.parametrize("text", ["192.168.1.255\n", "300.0.0.1", "192.168.1", "192.168.01.1", "::1"])
def test_another_is_no_hosts(text: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(text, Ipv4)
