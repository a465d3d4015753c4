"""The replay window, and old boots."""

from __future__ import annotations

from companion.core.clock import NS_PER_S
from companion.neighbours.session import Freshness, ReplayWindow, SenderSession
from tests.datagrams import boot


def test_each_counter_is_fresh_once_within_a_window() -> None:
    window = ReplayWindow()
    for counter in (5, 3, 70, 7, 8):
        assert window.is_fresh(counter)
        window.mark(counter)
    for counter in (5, 3, 70, 7, 8, 6, 0):  # 6 and 0 are too old to tell
        assert window.is_fresh(counter) is (counter == 6 and 70 - 6 < 64)
    assert window.is_fresh(69)
    assert window.is_fresh(10_000)


def test_one_that_starts_again_and_again_is_no_two() -> None:
    session = SenderSession(None)
    for number in range(1, 12):
        for counter in range(20):
            now_ns = (2 * number * 10 + counter) * NS_PER_S // 10
            assert session.judge(boot(number), counter, now_ns) is Freshness.FRESH
    assert session.rivals is None


def test_an_old_boot_that_was_never_heard_live_is_a_replay_not_a_rival() -> None:
    session = SenderSession(None)
    for number in range(20):
        assert session.judge(boot(9), number, number * NS_PER_S) is Freshness.FRESH
        assert session.judge(boot(3), number, number * NS_PER_S) is Freshness.REPLAY
    assert session.rivals is None
