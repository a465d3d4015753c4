"""The part of a report that moves, and its summary in words."""

from __future__ import annotations

from dataclasses import replace

from companion.report.content import FlightContent
from companion.report.moments import scrubbing, summary_of


def test_the_page_of_it_needs_nothing_from_elsewhere(content: FlightContent) -> None:
    text = scrubbing(content)
    assert "<script src" not in text and "<link" not in text
    assert text.count("</script>") == 5
    assert summary_of(content).startswith("Did not reach the target: the log ends while approaching")


def test_a_beacon_is_said_to_have_served(content: FlightContent) -> None:
    config = replace(content.config, role="beacon", autopilot=None)
    assert summary_of(FlightContent(session=content.session, config=config, duration_s=9.0)).endswith("served for 9 s.")
