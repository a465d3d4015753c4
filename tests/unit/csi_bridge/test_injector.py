"""Pings byte for byte, and what of a capture is one."""

from __future__ import annotations

import pytest

from csi_bridge.injector import (
    CARD_ADDRESS,
    Injector,
    InjectorError,
    Ping,
    echo_frame,
    parse_capture,
    ping_frame,
    radiotap,
    vht_radiotap,
)

MAC = bytes.fromhex("00216a5389d2")


OTHER = bytes.fromhex("00216a3f175a")


def test_the_counter_is_where_the_patched_driver_reads_it() -> None:
    frame = ping_frame(MAC, 0xA1B2C3D4, 57)
    assert len(frame) + 4 == 57
    assert frame[24:28].hex() == "a1b2c3d4"
    assert frame[16:22] == MAC
    assert frame[4:10] == frame[10:16] == CARD_ADDRESS
    assert ping_frame(MAC, 1 << 32, 57)[24:28] == bytes(4)
    with pytest.raises(ValueError, match="at least 32"):
        ping_frame(MAC, 1, 31)


def test_an_answer_is_told_from_a_ping_by_its_length() -> None:
    ping = parse_capture(radiotap(1) + ping_frame(MAC, 7, 57))
    assert ping == Ping(MAC, 7, 53)
    answer = parse_capture(radiotap(1) + echo_frame(ping, OTHER, ping.length))
    assert answer is not None
    assert (answer.mac, answer.counter) == (OTHER, 7)
    assert answer.length == ping.length + 1


def test_among_ax_cards_address_2_is_the_senders_and_address_3_names_who_answers() -> None:
    ping = parse_capture(vht_radiotap(1, 160) + ping_frame(MAC, 7, 57, OTHER))
    assert ping == Ping(MAC, 7, 53, OTHER)
    answer = parse_capture(vht_radiotap(1, 160) + echo_frame(ping, OTHER, ping.length))
    assert answer == Ping(OTHER, 7, 54, MAC)


def test_anything_else_is_no_ping() -> None:
    good = radiotap(1) + ping_frame(MAC, 7, 57)
    assert parse_capture(b"") is None
    assert parse_capture(good[:30]) is None
    assert parse_capture(b"\x01" + good[1:]) is None
    beacon = bytearray(good)
    beacon[len(radiotap(1))] = 0x80
    assert parse_capture(bytes(beacon)) is None
    with_check_sum = bytes([0, 0, 9, 0, 2, 0, 0, 0, 0x10]) + ping_frame(MAC, 7, 57) + b"\0\0\0\0"
    assert parse_capture(with_check_sum) == Ping(MAC, 7, 53)
    with_time = bytes([0, 0, 17, 0, 3, 0, 0, 0]) + bytes(8) + b"\x10" + ping_frame(MAC, 7, 57) + b"\0\0\0\0"
    assert parse_capture(with_time) == Ping(MAC, 7, 53)


def test_a_missing_interface_is_named() -> None:
    with pytest.raises(InjectorError, match="nosuch0"):
        Injector("nosuch0", 1)
