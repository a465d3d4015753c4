"""Bytes that an interface has sent, as the kernel counts them."""

from __future__ import annotations

from companion.core.clock import NS_PER_S
from companion.radio.traffic import Traffic, sent_bytes


def test_traffic_of_a_real_interface_is_counted_and_a_missing_one_left_out() -> None:
    traffic = Traffic(["lo", "nosuch0", None])
    before = sent_bytes("lo")
    assert before is not None
    assert traffic.bytes_per_s(0) == {}
    rates = traffic.bytes_per_s(NS_PER_S)
    assert list(rates) == ["lo"]
    assert rates["lo"] >= 0
    assert sent_bytes("nosuch0") is None
