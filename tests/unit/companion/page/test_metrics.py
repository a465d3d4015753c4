"""Metrics as Prometheus reads them: each family once, with help and type, names by its conventions."""

from __future__ import annotations

import re

from companion.page.metrics import metrics_text
from companion.page.model import Model
from tests.unit.companion.page.test_model import flown

_SAMPLE = re.compile(r'([a-z_]+)(\{([a-z]+="[^"\n]*"(,[a-z]+="[^"\n]*")*)\})? (-?[0-9.e+-]+)')


def test_the_text_is_what_prometheus_reads() -> None:
    text = metrics_text(flown(), 0.1, viewers=2, dropped=3)
    assert text.endswith("\n")
    kinds: dict[str, str] = {}
    for line in text.splitlines():
        if line.startswith("# TYPE "):
            _, _, name, kind = line.split()
            assert name not in kinds
            kinds[name] = kind
        elif not line.startswith("# HELP "):
            found = _SAMPLE.fullmatch(line)
            assert found, line
            assert found[1] in kinds
    assert all(name.startswith("companion_") for name in kinds)
    assert all((kind == "counter") == name.endswith("_total") for name, kind in kinds.items())
    assert 'companion_mission_state{state="approaching"} 1' in text
    assert 'companion_messages_total{kind="packets"} 700' in text
    assert "companion_page_viewers 2" in text
    assert "companion_target_range_deviation_meters 1.5" in text


def test_a_page_that_knows_nothing_says_little() -> None:
    text = metrics_text(Model(), 9.0, viewers=0, dropped=0)
    assert "companion_feed_silence_seconds 9" in text
    assert "vehicle" not in text and "None" not in text


def test_names_of_robots_are_quoted() -> None:
    model = flown()
    assert model.health is not None
    model.health["neighbours"]['a "b"\\'] = model.health["neighbours"]["beacon"]
    assert 'neighbour="a \\"b\\"\\\\"' in metrics_text(model, 0.1, 0, 0)
