"""Another processor rounds otherwise: the golden decisions are the same there, within the tolerances of a check."""

from __future__ import annotations

import dataclasses
import random
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.core.streams import POSE_IN
from companion.log.reader import LoggedMessage, Session, open_session
from companion.replay.player import DECISION_TOPICS, INPUT_TOPICS
from tests.golden.golden_logs import GOLDEN, moved, replayed_as

_PLACE = struct.Struct("<3d")
_PLACE_AT = 8
_MOST_M = 3e-8
"""Phases move by as much as single precision rounds them."""


class _Shaken(Session):
    """A golden log whose poses are off by some hundredths of a micrometre."""

    seed = 0

    def messages(self, *asked: object, **others: object) -> Iterator[LoggedMessage]:
        rng = random.Random(self.seed)
        for message in super().messages(INPUT_TOPICS | DECISION_TOPICS):
            if message.topic == POSE_IN.topic:
                data = bytearray(message.data)
                place_m = (x + rng.uniform(-_MOST_M, _MOST_M) for x in _PLACE.unpack_from(data, _PLACE_AT))
                _PLACE.pack_into(data, _PLACE_AT, *place_m)
                message = dataclasses.replace(message, data=bytes(data))
            yield message


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("path", GOLDEN, ids=[path.stem for path in GOLDEN])
def test_what_rounds_otherwise_decides_the_same(path: Path, seed: int) -> None:
    _Shaken.seed = seed
    shaken = replayed_as(_Shaken, path)
    found = moved(open_session(path), shaken)
    assert [(one.topic, str(one.difference)) for one in found if one.topic != "/aperture"] == []
    assert shaken.decided
