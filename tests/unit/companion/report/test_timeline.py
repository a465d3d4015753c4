"""A flight moment by moment: everything that a browser needs, in bounds that a page can carry."""

from __future__ import annotations

import base64
import io
import itertools
import json

import numpy as np
import pytest
from PIL import Image

from companion.report import timeline
from companion.report.content import FlightContent
from companion.report.timeline import _sprite, _thinned
from tests.golden.golden_logs import GOLDEN


def test_a_flight_is_there_at_every_moment(content: FlightContent) -> None:
    assert content.timeline is not None
    told = content.timeline.content({})
    times = [row[0] for row in told["track"]]
    assert times == sorted(times) and content.duration_s - times[-1] < 1.0
    assert max(b - a for a, b in itertools.pairwise(times)) < 1.0
    assert [row[1] for row in told["missions"]][-1] == "approaching"
    assert len(told["bearings"]) == sum(one.estimate is not None for one in content.iterations)
    assert all("None" not in json.dumps(one) for one in told["bearings"])
    assert told["about"]["source"] == GOLDEN[0].name
    json.dumps(told, allow_nan=False)


def test_profiles_come_back_from_their_picture() -> None:
    cells = np.zeros((60, 120), np.uint8)
    cells[3, 6] = 255
    told = _sprite([(4, cells), (7, cells.T.reshape(60, 120))])
    assert told is not None and told["numbers"] == [4, 7]
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(told["png"].split(",")[1]))))
    assert picture.shape == (120, 120) and picture[3, 6] == 255 and picture[:60].sum() == 255


def test_a_long_flight_stays_within_its_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline, "_PROFILES_BYTES", 40_000)
    rng = np.random.default_rng(1)
    told = _sprite([(k, rng.integers(0, 255, (60, 120), np.uint8)) for k in range(40)])
    assert told is not None and 1 < len(told["numbers"]) < 40
    assert len(told["png"]) <= 40_000
    assert _sprite([]) is None


def test_rows_are_thinned_evenly_and_keep_the_last() -> None:
    assert _thinned(list(range(10)), 20) == list(range(10))
    few = _thinned(list(range(1000)), 100)
    assert len(few) <= 101 and few[0] == 0 and few[-1] == 999
