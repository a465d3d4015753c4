"""The streams of a log."""

from __future__ import annotations

from companion.core.streams import (
    STREAMS,
)


def test_every_stream_has_a_topic_of_its_own() -> None:
    topics = [stream.topic for stream in STREAMS]
    assert len(set(topics)) == len(topics)
