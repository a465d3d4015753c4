"""Wilson's interval, against a published example and where it matters: at no failure at all."""

from __future__ import annotations

import pytest

from companion.study.shares import Share


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    # Newcombe, Statistics in Medicine 17 (1998), table I, method 3.
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_the_interval_is_the_published_one(count: int, total: int, low: float, high: float) -> None:
    share = Share(count, total)
    assert (share.low, share.high) == pytest.approx((low, high), abs=5e-5)
    assert share.low <= share.value <= share.high
    mirrored = Share(total - count, total)
    assert (mirrored.low, mirrored.high) == pytest.approx((1 - high, 1 - low), abs=5e-5)


def test_a_share_is_shown_in_percent() -> None:
    assert str(Share(2, 4)) == "50 (15-85)"
