"""What passes to the process that computes the team comes out as it went in."""

from __future__ import annotations

import math

import msgspec

from companion.team.news import LENGTH, News, framed
from companion.team.records import RawSighting


def test_news_come_back_whole_with_what_was_not_observed_infinite() -> None:
    sighting = RawSighting(
        observer=1,
        target=2,
        number=7,
        t_ns=9,
        azimuth_rad=0.5,
        azimuth_std_rad=0.02,
        polar_rad=1.5,
        polar_std_rad=math.inf,
        range_m=None,
        range_std_m=math.inf,
        reliability=0.8,
        fresh=1.0,
        boot=3,
    )
    news = News(10, [(2, 1, 9, (1.0, 2.0, 3.0))], [sighting])
    data = framed(news)
    (size,) = LENGTH.unpack_from(data)
    assert size == len(data) - LENGTH.size
    assert msgspec.msgpack.decode(data[LENGTH.size :], type=News) == news
