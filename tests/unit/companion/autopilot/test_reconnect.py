"""How long is waited before the link is opened again."""

from __future__ import annotations

from companion.autopilot.reconnect import Backoff


def test_a_failed_connection_waits_longer_each_time_up_to_a_cap() -> None:
    backoff = Backoff()
    levels, waits = [], []
    for failures in range(7):
        assert backoff.failures == failures
        levels.append(backoff.level)
        waits.append(backoff.next_s())
    assert waits == [0.5, 1, 2, 4, 8, 8, 8]
    assert levels[0] > levels[1] == levels[-1]
