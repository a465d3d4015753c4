"""Which packets of two logs are one exchange, and what becomes of the others."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from companion.analysis.exchanges import (
    DUPLICATE,
    UNPAIRED,
    WEAK,
    WIDE,
    ExchangeError,
    damage,
    heard_s,
    join,
    read_log,
    receiver_mac,
    senders,
    transmitter_mac,
)
from csi_bridge.dat import CsiLog
from tests.synthetic_run import EXCHANGES, RX_MAC, START_S, TX_MAC, RunFolder, path_m
from wsr.channel import wavelength_m


def _both(run: RunFolder) -> tuple[CsiLog, CsiLog]:
    return read_log(run.rx), read_log(run.tx)


def _kept(log: CsiLog, keep: np.ndarray) -> CsiLog:
    """The same log with some of its records."""
    arrays = {name: getattr(log, name) for name in log.__slots__}
    return replace(log, **{n: v[keep] for n, v in arrays.items() if isinstance(v, np.ndarray) and len(v) == len(log)})


def test_every_exchange_of_a_run_is_found_and_its_product_turns_with_the_path(run: RunFolder) -> None:
    found = join(*_both(run), TX_MAC)
    assert (len(found.t_s), found.packets, found.dropped) == (EXCHANGES, EXCHANGES, {})
    assert found.t_s == pytest.approx(found.tx_t_s + 3e-4, abs=1e-4), "the answer comes after the ping"
    distance = np.linalg.norm(path_m(found.t_s - START_S) - [3.0, 6.0, 2.5], axis=1)
    turned = found.channel * np.exp(4j * np.pi / wavelength_m(108) * distance)
    assert abs(turned.sum()) > 0.98 * np.abs(turned).sum()
    assert found.grid is None
    assert not found.half_turns


def test_of_the_transmitters_channels_its_datagrams_would_have_brought_nearly_all(run: RunFolder) -> None:
    reduced, whole = join(*_both(run), TX_MAC), join(*_both(run), TX_MAC, reduced=False)
    np.testing.assert_array_equal(reduced.forward, whole.forward)
    assert not np.array_equal(reduced.reverse, whole.reverse)
    kept = np.abs(reduced.channel) / np.abs(whole.channel)
    assert np.median(kept) == pytest.approx(1.0, abs=0.05)


def test_each_reason_not_to_use_a_packet_is_counted(run: RunFolder) -> None:
    rx, tx = _both(run)
    lost = np.ones(len(tx), np.bool_)
    lost[:30] = False
    assert join(rx, _kept(tx, lost), TX_MAC).dropped == {UNPAIRED: 30}
    twice = rx.frame_count.copy()
    twice[10] = twice[11]
    doubled = join(replace(rx, frame_count=twice), tx, TX_MAC)
    assert doubled.dropped == {DUPLICATE: 2}
    silent = rx.csi.copy()
    silent[:7] = 0
    assert join(replace(rx, csi=silent), tx, TX_MAC).dropped == {WEAK: 7}
    wide = rx.rate.copy()
    wide[:5] |= np.uint16(1 << 11)
    assert join(replace(rx, rate=wide), tx, TX_MAC).dropped == {WIDE: 5}


def test_links_without_anything_in_common_say_why(run: RunFolder) -> None:
    rx, tx = _both(run)
    with pytest.raises(ExchangeError, match="no exchange in common: not of the same run"):
        join(rx, replace(tx, frame_count=tx.frame_count + 100_000), TX_MAC)
    with pytest.raises(ExchangeError, match=r"are not of the same run: .* spread by .* ms"):
        slower = replace(tx, host_time_s=tx.host_time_s[0] + 1.01 * (tx.host_time_s - tx.host_time_s[0]))
        join(rx, replace(slower, timestamp_low_us=(1.01 * np.arange(len(tx)) * 7600).astype(np.uint32)), TX_MAC)
    with pytest.raises(ExchangeError, match="40 MHz wide"):
        join(replace(rx, rate=rx.rate | np.uint16(1 << 11)), tx, TX_MAC)
    with pytest.raises(ExchangeError, match="the card measured nothing"):
        join(replace(rx, csi=0 * rx.csi), tx, TX_MAC)


def test_logs_of_two_runs_joined_end_to_end_are_said_to_be(run: RunFolder) -> None:
    rx, tx = _both(run)
    run.tx.write_bytes(2 * run.tx.read_bytes())
    told = f"{run.tx} holds more than one run, or one twice: the frame counters of {RX_MAC} begin again at 1"
    with pytest.raises(ExchangeError, match=re.escape(told)):
        join(rx, read_log(run.tx), TX_MAC)
    repeated = replace(rx, frame_count=np.repeat(rx.frame_count[::2], 2))
    with pytest.raises(ExchangeError, match="every frame counter is there twice"):
        join(repeated, tx, TX_MAC)


def test_the_other_end_is_the_sender_that_its_own_log_lacks(run: RunFolder) -> None:
    rx, tx = _both(run)
    assert senders(rx) == {TX_MAC: EXCHANGES}
    assert receiver_mac(rx, tx) == RX_MAC
    assert transmitter_mac("tx2", rx, tx) == transmitter_mac("robot", rx, tx) == TX_MAC
    with pytest.raises(ExchangeError, match=r"no packets of 00:00:00:00:00:07; senders heard: 00:21"):
        transmitter_mac("tx2", rx, tx, given="00:00:00:00:00:07")
    with pytest.raises(ExchangeError, match="no packets of the receiving robot"):
        receiver_mac(tx, tx)
    assert transmitter_mac("tx1", rx, tx) == TX_MAC, "one that is not there, and one sender it can be"


def test_a_log_that_holds_packets_of_its_own_card_is_another_ends(run: RunFolder) -> None:
    rx, tx = _both(run)
    for name, given in (("tx2", None), ("robot", TX_MAC)):
        expected = "the ends look swapped: " if given is None else "holds some: .* are the ends swapped"
        with pytest.raises(ExchangeError, match=expected) as told:
            transmitter_mac(name, tx, rx, given)
        assert str(rx.path) in str(told.value) and str(tx.path) in str(told.value) and "\n" not in str(told.value)
        with pytest.raises(ExchangeError, match=f"own card, .* is it another robot's log, as {run.rx} is"):
            transmitter_mac(name, rx, rx, given)
    assert transmitter_mac("robot", tx, rx) == RX_MAC, "of cards that are not known either may be either's"


def test_times_are_the_receivers_and_damage_is_said(run: RunFolder) -> None:
    rx = read_log(run.rx)
    assert len(heard_s(rx, TX_MAC)) == EXCHANGES
    assert len(heard_s(rx, RX_MAC)) == 0
    assert list(damage(rx)) == []
    content = bytearray(run.rx.read_bytes())
    content[2000:2100] = bytes(100)
    run.rx.write_bytes(content)
    (told,) = damage(read_log(run.rx))
    assert "malformed records" in told
    with pytest.raises(ExchangeError, match="No such file"):
        read_log(Path("nowhere.dat"))
