"""Sentences in chunks, values by name; nothing of it is longer than its field."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.autopilot.ground_station import CHUNK, MOST_CHUNKS, GroundStation, chunks


class Sent:
    def __init__(self) -> None:
        self.messages: list[tuple[str, dict[str, Any]]] = []

    def send(self, name: str, /, **fields: Any) -> None:
        self.messages.append((name, fields))


def test_a_short_sentence_is_one_message_without_an_id() -> None:
    sent = Sent()
    GroundStation(sent, lambda: 5).say(4, "holding")
    assert sent.messages == [("STATUSTEXT", {"severity": 4, "text": "holding", "id": 0, "chunk_seq": 0})]


def test_a_long_one_is_put_together_again_by_its_id() -> None:
    sent, text = Sent(), "engage refused: " + "; ".join(f"reason {n}" for n in range(8))
    station = GroundStation(sent, lambda: 5)
    station.say(4, text)
    station.say(4, text)
    assert {fields["id"] for _, fields in sent.messages} == {1, 2}
    first = [fields for _, fields in sent.messages if fields["id"] == 1]
    assert [fields["chunk_seq"] for fields in first] == list(range(len(first)))
    assert "".join(fields["text"] for fields in first) == text


@given(st.text("aZ 0.,\n\0äß€😀\u0301\udc80", max_size=500))
def test_chunks_are_ascii_and_end_with_a_short_one(text: str) -> None:
    parts = chunks(text)
    assert 1 <= len(parts) <= MOST_CHUNKS
    assert all(part.isascii() and len(part) <= CHUNK for part in parts)
    assert len(parts) == 1 or (all(len(part) == CHUNK for part in parts[:-1]) and len(parts[-1]) < CHUNK)


@pytest.mark.parametrize("length", [49, 50, 51, 100, 199, 200, 1000])
def test_what_is_too_long_ends_with_dots(length: int) -> None:
    text = "".join(chunks("x" * length))
    assert text == ("x" * length if length < CHUNK * MOST_CHUNKS else "x" * 196 + "...")


def test_what_is_not_known_is_not_a_number() -> None:
    sent = Sent()
    station = GroundStation(sent, lambda: 1234)
    station.show("wsr_range", 6.5)
    station.show("wsr_range", None)
    station.show("wsr_rng_sd", math.inf)
    values = [fields["value"] for _, fields in sent.messages]
    assert values == [6.5, None, None]
    assert sent.messages[0][1] == {"time_boot_ms": 1234, "name": "wsr_range", "value": 6.5}
